//! Cylinder-Cech complexes of oriented point clouds: exact nerve, persistent Betti numbers, loops, boundary and non-manifold points
