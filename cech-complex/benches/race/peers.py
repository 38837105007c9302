"""One peer on one cloud: `peers.py NAME POINTS.txt RADIUS` prints simplices, Betti numbers and CPU seconds as one JSON line.

Reading and importing are not counted; distances, complex and reduction are.
"""

import json
import sys
import time

import numpy


def alive(intervals, scale):
    """Intervals born by `scale` and alive after it."""
    return sum(1 for birth, death in intervals if birth <= scale and death > scale)


def gudhi_rips(points, radius, collapse):
    import gudhi

    def work():
        tree = gudhi.RipsComplex(points=points, max_edge_length=2 * radius).create_simplex_tree(max_dimension=1)
        if collapse:
            tree.collapse_edges()
        tree.expansion(3)
        tree.compute_persistence(homology_coeff_field=2, min_persistence=0)
        return tree.num_simplices(), [alive(tree.persistence_intervals_in_dimension(k), 2 * radius) for k in range(3)]

    return work


def gudhi_alpha(points, radius):
    import gudhi

    def work():
        tree = gudhi.AlphaComplex(points=points, precision="fast").create_simplex_tree(max_alpha_square=radius**2)
        # Without it the top dimension of a thresholded complex is dropped (GUDHI #878).
        tree.compute_persistence(homology_coeff_field=2, min_persistence=0, persistence_dim_max=True)
        return tree.num_simplices(), [alive(tree.persistence_intervals_in_dimension(k), radius**2) for k in range(3)]

    return work


def ripser_sparse(points, radius):
    import ripser
    from scipy.spatial import cKDTree

    def work():
        distances = cKDTree(points).sparse_distance_matrix(cKDTree(points), 2 * radius, output_type="coo_matrix")
        diagrams = ripser.ripser(distances, maxdim=2, thresh=2 * radius, distance_matrix=True)["dgms"]
        return 0, [alive(diagram, 2 * radius) for diagram in diagrams]

    return work


def oineus_rips(points, radius):
    import oineus

    def work():
        filtration = oineus.vr_filtration(points, max_dim=3, max_diameter=2 * radius, n_threads=1)
        decomposition = oineus.Decomposition(filtration, True)
        settings = oineus.ReductionParams()
        settings.clearing_opt = True
        settings.n_threads = 1
        decomposition.reduce(settings)
        diagrams = decomposition.diagram(filtration)
        return filtration.size(), [alive(diagrams.in_dimension(k), 2 * radius) for k in range(3)]

    return work


def dionysus_rips(points, radius):
    import dionysus

    def work():
        filtration = dionysus.fill_rips(points, 3, 2 * radius)
        reduced = dionysus.homology_persistence(filtration, prime=2, method="clearing")
        diagrams = dionysus.init_diagrams(reduced, filtration)
        intervals = [[(bar.birth, bar.death) for bar in diagram] for diagram in diagrams]
        return len(filtration), [alive(intervals[k], 2 * radius) for k in range(3)]

    return work


PEERS = {
    "GUDHI Rips dim 3": lambda points, radius: gudhi_rips(points, radius, False),
    "GUDHI Rips collapsed": lambda points, radius: gudhi_rips(points, radius, True),
    "GUDHI alpha": gudhi_alpha,
    "ripser.py sparse": ripser_sparse,
    "oineus VR": oineus_rips,
    "dionysus Rips": dionysus_rips,
}


def main():
    name, file, radius = sys.argv[1:]
    work = PEERS[name](numpy.loadtxt(file), float(radius))
    start = time.process_time()
    simplices, betti = work()
    seconds = time.process_time() - start
    print(json.dumps({"simplices": int(simplices), "betti": [int(b) for b in betti], "seconds": seconds}))


if __name__ == "__main__":
    main()
