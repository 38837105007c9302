//! The local shape of the surface around a vertex. See [`LocalHomology`] for the definition and the reason for two radii.

use crate::cohomology::{Coboundary, NONE, Pairing, reduce};
use crate::complex::Complex;
use crate::error::{Error, positive};
use crate::geodesic::ShortestPaths;
use crate::skeleton::run;
use std::f64::consts::FRAC_PI_2;

/// Radius `ρ` of the ball, in spacings.
const BALL: f64 = 2.0;
/// Smallest `ρ` in radii of the cylinder: in a ball not much wider than a disc no region is left uncovered.
const BALL_PER_RADIUS: f64 = 1.6;
/// Radius `ρ′` of the core, in `ρ`.
const CORE: f64 = 0.875;
/// Smallest cosine between the normals of a closed fan.
const SAME_WAY: f64 = 0.5;
/// Scale at which vertices are classified: the cylinder's own size.
const SCALE: f64 = 1.0;
/// Scale at which a non-manifold vertex must be confirmed: pinholes of the nerve itself last up to 1 % of scale (test `lemma`).
const CONFIRMING_SCALE: f64 = 0.98;
/// Radius of the ball in which a third sheet is looked for, in `ρ`.
const WIDE: f64 = 1.125;

/// Kind of a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum VertexKind {
    /// The complex around it is a disc.
    Interior,
    /// The complex around it is a half-disc: within about two spacings of the boundary.
    Boundary,
    /// Sheets meet, or a strip is narrower than the ball: not a surface at this resolution.
    NonManifold,
    /// It has no neighbour (or has been cut).
    Isolated,
}

/// Ranks of the local homology of a vertex: the image for two radii.
///
/// ```text
/// K_{>ρ}(v)    vertices of geodesic distance over ρ from v, and all simplices among them
/// H_k(v) = image of  H_k(K, K_{>ρ}; Z/2) → H_k(K, K_{>ρ′}; Z/2),   ρ′ < ρ
/// rank H₂ = 1, H₁ = 0 inside a surface;   H₂ = 0, H₁ = 0 at its boundary;   otherwise not a manifold
/// ```
///
/// The link of a vertex in a nerve is not a triangulated circle, so the usual test on links does not apply; local homology does not depend on the
/// number of simplices. Distances are geodesic, so that a second sheet nearby has no effect.
///
/// **Two radii.** Let `U_ρ` be the region that the cylinders farther than `ρ` leave uncovered. Inside a surface `H₂(K, K_{>ρ})` counts the components of `U_ρ`
/// that do not touch the boundary, and `H₁` its holes. `U_ρ` is a disc around `v`, except that for about one vertex in a thousand it has a second, small component
/// at the edge, between two samples just outside; such a vertex has rank 2 without being pinched. This component is covered before `ρ` has shrunk
/// by a quarter of a spacing, so it is not in the image (persistent local homology: Bendich, Cohen-Steiner, Edelsbrunner, Harer and Morozov 2007).
/// One reduction gives the image: its classes are those created by a simplex with a vertex within `ρ′` if simplices without one come first.
///
/// No outer radius is needed: only simplices with a vertex within `ρ` are relative chains (excision).
/// `ρ = 2` spacings, because for smaller `ρ` the ring around `U_ρ` has gaps; `ρ′ = 1.75` spacings, because at 1.5 a third sheet that ends within the height of the
/// cylinders is missed. A third sheet is also looked for in a ball of 2.25 spacings, if some vertex there faces elsewhere: beside tall cylinders
/// its own surface begins farther away. What is found must still be there when all cylinders are 2 % smaller, so that no pinhole counts.
/// `cargo run --release -p cech-complex --features manifolds --example kinds -- 30` counts the errors.
///
/// **Certificate.** A vertex has a *closed fan* if its neighbours within `ρ`, sorted by angle in its tangent plane, have similar normals,
/// leave no gap of 90°, and each forms a triangle with the next and the vertex. If that holds for all vertices within `ρ`, there is neither
/// boundary nor junction, and the vertex is inside. All other vertices are decided by the definition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LocalHomology {
    /// Rank in dimension 1.
    pub h1: usize,
    /// Rank in dimension 2.
    pub h2: usize,
}

impl LocalHomology {
    /// The kind of vertex with these ranks.
    pub fn kind(self) -> VertexKind {
        match (self.h1, self.h2) {
            (0, 1) => VertexKind::Interior,
            (0, 0) => VertexKind::Boundary,
            _ => VertexKind::NonManifold,
        }
    }
}

impl Complex {
    /// Kind of every vertex, at scale 1, for a cloud of the given `spacing` (m).
    ///
    /// # Errors
    /// [`Error::NotPositive`] for the spacing.
    ///
    /// # Complexity
    /// About 2 µs for a vertex decided by the certificate and 0.1 ms for any other.
    ///
    /// # Limits
    /// `Boundary` means within about two spacings of the boundary, `NonManifold` within about one of a junction. On ε-nets whose gaps the cylinders cover
    /// (`cargo run --release -p cech-complex --features manifolds --example kinds -- 30`): no vertex of 396,000 on closed surfaces and of
    /// 144,000 on open ones is classified as non-manifold; all but seven vertices within 1.5 ε of the boundary are `Boundary`, and none
    /// beyond 2.7 ε; within ε of a junction 99.8 % are found with cylinders half as high as their radius, and as many with cylinders as high as their
    /// radius. The vertices of a strip narrower than four spacings are `NonManifold` although a strip is a surface. Where the sampling leaves a
    /// hole in the complex, the vertices around it are boundary vertices.
    ///
    /// ```
    /// use cech_complex::manifolds::Manifold;
    /// use cech_complex::{Complex, Cylinder, Options, VertexKind};
    ///
    /// let tube = Manifold::Tube { radius: 0.5, length: 1.5 }.net(500, 1);
    /// let cylinder = Cylinder::new(1.25 * tube.spacing, tube.spacing)?;
    /// let complex = Complex::build(&tube.points, &tube.normals, cylinder, &Options::default())?;
    /// let kinds = complex.classify(tube.spacing)?;
    /// for (point, kind) in tube.points.iter().zip(&kinds) {
    ///     if point.z.abs() < 0.3 {
    ///         assert_eq!(*kind, VertexKind::Interior);
    ///     } else if point.z.abs() > 0.7 {
    ///         assert_eq!(*kind, VertexKind::Boundary);
    ///     }
    /// }
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
    pub fn classify(&self, spacing: f64) -> Result<Vec<VertexKind>, Error> {
        positive("spacing", spacing)?;
        let radius = self.ball_radius(spacing);
        let mut around = Surroundings::new(self);
        let vertices = 0..self.points.len() as u32;
        let closed: Vec<bool> = vertices
            .clone()
            .map(|v| self.has_closed_fan(v, radius))
            .collect();
        Ok(vertices.map(|v| around.kind(v, radius, &closed)).collect())
    }

    /// Local homology of one vertex at scale 1 by its definition, without the certificate: ranks of
    /// `H_k(K, K_{>ρ}) → H_k(K, K_{>ρ′})` over Z/2, where `K_{>ρ}` is spanned by the vertices of geodesic distance over
    /// `ρ = 2` spacings (1.6 radii of the cylinder if that is more), and `ρ′ = 7/8 ρ`.
    ///
    /// # Errors
    /// [`Error::NoSuchVertex`], [`Error::NotPositive`].
    ///
    /// # Complexity
    /// About 0.1 ms.
    ///
    /// ```
    /// use cech_complex::manifolds::Manifold;
    /// use cech_complex::{Complex, Cylinder, Options};
    ///
    /// let tube = Manifold::Tube { radius: 0.5, length: 1.5 }.net(500, 1);
    /// let cylinder = Cylinder::new(1.25 * tube.spacing, tube.spacing)?;
    /// let complex = Complex::build(&tube.points, &tube.normals, cylinder, &Options::default())?;
    /// let middle = (0..500).find(|&v| tube.points[v].z.abs() < 0.1).unwrap();
    /// let there = complex.local_homology(middle as u32, tube.spacing)?;
    /// assert_eq!((there.h1, there.h2), (0, 1)); // a disc
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
    pub fn local_homology(&self, vertex: u32, spacing: f64) -> Result<LocalHomology, Error> {
        self.check_vertex(vertex)?;
        positive("spacing", spacing)?;
        Ok(Surroundings::new(self).homology(vertex, self.ball_radius(spacing), SCALE))
    }

    fn ball_radius(&self, spacing: f64) -> f64 {
        (BALL * spacing).max(BALL_PER_RADIUS * self.cylinder.radius())
    }

    fn has_closed_fan(&self, v: u32, radius: f64) -> bool {
        let normal = self.normals[v as usize].into_inner();
        // Any tangent will do: the angles are only compared with each other.
        let axis = if normal.x.abs() < 0.6 {
            nalgebra::Vector3::x()
        } else {
            nalgebra::Vector3::y()
        };
        let u = normal.cross(&axis).normalize();
        let w = normal.cross(&u);
        let mut fan: Vec<(f64, u32)> = Vec::new();
        for (&neighbour, &edge) in self
            .adjacency
            .neighbours(v)
            .iter()
            .zip(self.adjacency.edges(v))
        {
            let d = self.points[neighbour as usize] - self.points[v as usize];
            if !self.edge_within(edge as usize, SCALE) || d.norm() > radius {
                continue;
            }
            if self.normals[neighbour as usize].dot(&normal) < SAME_WAY {
                return false;
            }
            fan.push((w.dot(&d).atan2(u.dot(&d)), neighbour));
        }
        fan.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let closes = |i: usize| {
            let ((from, a), (to, b)) = (fan[i], fan[(i + 1) % fan.len()]);
            (to - from).rem_euclid(std::f64::consts::TAU) < FRAC_PI_2
                && self.has_triangle([v, a, b])
        };
        fan.len() > 3 && (0..fan.len()).all(closes)
    }

    fn has_triangle(&self, mut vertices: [u32; 3]) -> bool {
        vertices.sort_unstable();
        let skeleton = &self.skeleton;
        let Some(first) = skeleton.find_edge(vertices[0], vertices[1]) else {
            return false;
        };
        let range = run(&skeleton.triangle_runs, first);
        let found = skeleton.triangles[range.clone()].binary_search(&vertices);
        found.is_ok_and(|offset| self.triangle_within(range.start + offset, SCALE))
    }
}

/// Zone of a vertex: beyond `ρ`, between `ρ′` and `ρ`, within `ρ′`. The zone of a simplex is that of its innermost vertex.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Zone {
    Outside,
    Shell,
    Core,
}

/// The neighbourhood of one vertex at a time, with arrays reused from vertex to vertex.
struct Surroundings<'a> {
    complex: &'a Complex,
    paths: ShortestPaths,
    /// Column number of every vertex, edge and triangle of the open star.
    column: [Vec<u32>; 3],
}

/// Open star of a ball: by dimension, the simplices that have a vertex in it, each with its zone.
type Star = [Vec<(Zone, u32)>; 4];

impl<'a> Surroundings<'a> {
    fn new(complex: &'a Complex) -> Self {
        let [_, edges, triangles, _] = complex.counts();
        Self {
            complex,
            paths: ShortestPaths::new(complex.points.len()),
            column: [complex.points.len(), edges, triangles].map(|count| vec![NONE; count]),
        }
    }

    fn kind(&mut self, v: u32, radius: f64, closed: &[bool]) -> VertexKind {
        let edges = self.complex.adjacency.edges(v);
        if !(edges.iter()).any(|&e| self.complex.edge_within(e as usize, SCALE)) {
            return VertexKind::Isolated;
        }
        if closed[v as usize] {
            self.ball(v, radius, SCALE);
            if self.paths.settled.iter().all(|&u| closed[u as usize]) {
                return VertexKind::Interior;
            }
        }
        let wide = WIDE * radius;
        let kind = self.homology(v, radius, SCALE).kind();
        let suspected = kind == VertexKind::NonManifold
            || kind == VertexKind::Interior
                && self.has_other_sheet(v, wide)
                && self.homology(v, wide, SCALE).h2 > 1;
        if !suspected {
            return kind;
        }
        match self.homology(v, radius, CONFIRMING_SCALE).kind() {
            VertexKind::NonManifold => VertexKind::NonManifold,
            _ if self.homology(v, wide, CONFIRMING_SCALE).h2 > 1 => VertexKind::NonManifold,
            otherwise => otherwise,
        }
    }

    /// Whether the surface faces elsewhere at some vertex within `radius`.
    fn has_other_sheet(&mut self, v: u32, radius: f64) -> bool {
        self.ball(v, radius, SCALE);
        let normals = &self.complex.normals;
        let cosine = |u: &u32| normals[*u as usize].dot(&normals[v as usize]);
        self.paths.settled.iter().any(|u| cosine(u) < SAME_WAY)
    }

    fn ball(&mut self, v: u32, radius: f64, scale: f64) {
        let complex = self.complex;
        let weight = |e: u32| {
            complex
                .edge_within(e as usize, scale)
                .then(|| complex.length(e))
        };
        self.paths.run(complex, &[v], radius, weight);
    }

    /// The definition, in cohomology: essential classes of the relative complex whose first simplex has a vertex in the core.
    fn homology(&mut self, v: u32, radius: f64, scale: f64) -> LocalHomology {
        self.ball(v, radius, scale);
        let star = self.star(CORE * radius, scale);
        let [d0, d1, d2] = self.coboundaries(&star);
        let p0 = reduce(&d0, |_| false);
        let p1 = reduce(&d1, |edge| p0.column_of_row[edge as usize] != NONE);
        let p2 = reduce(&d2, |triangle| p1.column_of_row[triangle as usize] != NONE);
        let in_core = |pairing: &Pairing, cells: &[(Zone, u32)]| {
            let essential = pairing.essential.iter();
            essential
                .filter(|(column, _)| cells[*column as usize].0 == Zone::Core)
                .count()
        };
        LocalHomology {
            h1: in_core(&p1, &star[1]),
            h2: in_core(&p2, &star[2]),
        }
    }

    /// Coboundary matrices of the relative complex: facets outside the star have no column.
    fn coboundaries(&mut self, star: &Star) -> [Coboundary; 3] {
        for (column, cells) in self.column.iter_mut().zip(star) {
            for (i, &(_, cell)) in cells.iter().enumerate() {
                column[cell as usize] = i as u32;
            }
        }
        let skeleton = &self.complex.skeleton;
        let [vertices, edges, triangles] = &self.column;
        let matrices = [
            coboundary(&star[1], &skeleton.edges, star[0].len(), vertices),
            coboundary(&star[2], &skeleton.triangle_edges, star[1].len(), edges),
            coboundary(
                &star[3],
                &skeleton.tetrahedron_triangles,
                star[2].len(),
                triangles,
            ),
        ];
        for (column, cells) in self.column.iter_mut().zip(star) {
            for &(_, cell) in cells {
                column[cell as usize] = NONE;
            }
        }
        matrices
    }

    /// Open star of the ball in `ball`, simplices of the shell first.
    fn star(&self, core: f64, scale: f64) -> Star {
        let skeleton = &self.complex.skeleton;
        let distance = &self.paths.distance;
        let zone = |v: u32| match distance[v as usize] {
            d if d <= core => Zone::Core,
            d if d.is_finite() => Zone::Shell,
            _ => Zone::Outside,
        };
        let mut near = self.paths.settled.clone();
        for &v in &self.paths.settled {
            near.extend(self.complex.adjacency.neighbours(v));
        }
        near.sort_unstable();
        near.dedup();
        let mut star = Star::default();
        let mut keep = |dimension: usize, zone: Zone, cell: usize| {
            if zone > Zone::Outside {
                star[dimension].push((zone, cell as u32));
            }
        };
        let complex = self.complex;
        let edge_counts = |edge: &usize| complex.edge_within(*edge, scale);
        let triangle_counts = |triangle: &usize| complex.triangle_within(*triangle, scale);
        let tetrahedron_counts =
            |tetrahedron: &usize| complex.tetrahedron_within(*tetrahedron, scale);
        for &a in &near {
            let in_a = zone(a);
            keep(0, in_a, a as usize);
            for ab in run(&skeleton.edge_runs, a).filter(&edge_counts) {
                let in_ab = in_a.max(zone(skeleton.edges[ab][1]));
                keep(1, in_ab, ab);
                for abc in run(&skeleton.triangle_runs, ab as u32).filter(&triangle_counts) {
                    let in_abc = in_ab.max(zone(skeleton.triangles[abc][2]));
                    keep(2, in_abc, abc);
                    for abcd in
                        run(&skeleton.tetrahedron_runs, abc as u32).filter(&tetrahedron_counts)
                    {
                        keep(3, in_abc.max(zone(skeleton.tetrahedra[abcd][3])), abcd);
                    }
                }
            }
        }
        for cells in &mut star {
            cells.sort_by_key(|(zone, _)| *zone);
        }
        star
    }
}

/// The coboundary matrix from `columns` cells to the given cells of the next dimension; `column` numbers the facets.
fn coboundary<const N: usize>(
    cells: &[(Zone, u32)],
    facets: &[[u32; N]],
    columns: usize,
    column: &[u32],
) -> Coboundary {
    let named = |&(_, cell): &(Zone, u32)| facets[cell as usize].map(|f| column[f as usize]);
    let facets: Vec<[u32; N]> = cells.iter().map(named).collect();
    Coboundary::new(columns, &facets)
}
