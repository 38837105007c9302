//! The soft body on the table, simulated by rapier's constraint solver.
//!
//! Frames: the **world** is in metres, its origin on the table under the camera, +z up. The engine uses the same frame in
//! **decimetres**: it computes in `f32`, and takes a tetrahedron of less than 1.2·10⁻⁷ cubic units for degenerate, without
//! elasticity, which in metres would be every tetrahedron here. With lengths ×10 and time and mass unchanged,
//!
//! ```text
//! gravity ×10,   Young's modulus ÷10  (kg m⁻¹ s⁻²),   density ÷1000  (kg m⁻³).
//! ```
//!
//! A wall thinner than 10 mm would need too many tetrahedra. Instead, they fill the solid within `pad = (10 mm − t)/2` of it, with
//! the mass and the bending stiffness of the wall: `ρ' = ρ V/V'`, `E' = E (t/t')³`. The table is lowered by `pad`, so that the
//! surface itself touches it.
//!
//! The mass of each tetrahedron is divided among its four nodes. Nodes in a jaw are kinematic: they get a target for the end of
//! each step, and the engine gives them the matching velocity.

use nalgebra::{Point3, Vector3};
use rapier3d::prelude::{
    ColliderBuilder, PhysicsWorld, RigidBodyBuilder, SoftBodyBuilder, SoftBodyCellModel,
    SoftBodyHandle, SoftBodyMaterial, Vector,
};

use super::SimError;
use super::embedding::Embedding;
use super::lattice::{self, TetMesh};
use super::mesh::TriangleMesh;
use super::options::{Fidelity, Material};
use super::scene::Placed;

/// Decimetres in a metre.
const DM: f64 = 10.0;

/// Thickness of the contact skin, metres: the table is lowered by it, so that the surface touches it at z = 0.
const SKIN: f64 = 0.001;

/// Stretch of an edge, in rest lengths, at which the simulation has diverged or the tissue has torn.
const MAX_STRETCH: f64 = 3.0;

/// Stretch of the material next to a jaw, in rest lengths, at which the grip slips.
const SLIPS_AT: f64 = 2.7;

/// Largest distance of the surface from the tetrahedra, in lattice cells: flat faces cut off half a cell of a curved surface; more means
/// that the lattice missed a feature.
const MAX_GAP: f64 = 0.5;

pub(super) struct Body {
    world: PhysicsWorld,
    handle: SoftBodyHandle,
    embedding: Embedding,
    /// Edges of the tetrahedra with their rest lengths, metres.
    edges: Vec<([usize; 2], f64)>,
    nodes: Vec<Point3<f64>>,
    pub tetrahedra: usize,
    tets: Vec<[usize; 4]>,
}

impl Body {
    /// The solid bounded by the surface of a scene (world frame), above the table.
    pub fn new(
        placed: &Placed<'_>,
        material: &Material,
        fidelity: &Fidelity,
        step: f64,
    ) -> Result<Self, SimError> {
        let surface = &placed.apart();
        let Filled {
            mut mesh,
            embedding,
            pad,
        } = fill(surface, fidelity)?;
        let material = &padded(material, surface, &mesh, pad);
        for node in &mut mesh.nodes {
            *node = placed.at_rest(node);
        }
        let mut world = PhysicsWorld::new();
        world.gravity = Vector::new(0.0, 0.0, (-9.81 * DM) as f32);
        world.integration_parameters.dt = step as f32;
        world.integration_parameters.num_solver_iterations = fidelity.substeps;
        let half = Vector::new((2.0 * DM) as f32, (2.0 * DM) as f32, DM as f32);
        let top = -(SKIN + pad) * DM;
        world.insert(
            RigidBodyBuilder::fixed().translation(Vector::new(0.0, 0.0, (top - DM) as f32)),
            ColliderBuilder::cuboid(half.x, half.y, half.z).friction(material.friction as f32),
        );
        let handle = world.insert_soft_body(builder(&mesh, material, fidelity));
        let edges = edges(&mesh);
        Ok(Self {
            world,
            handle,
            embedding,
            edges,
            nodes: mesh.nodes,
            tetrahedra: mesh.tets.len(),
            tets: mesh.tets,
        })
    }

    /// Advances one step; `targets` are the world positions of pinned nodes at its end.
    pub fn step(&mut self, targets: &[(usize, Point3<f64>)]) {
        let body = &mut self.world.soft_bodies[self.handle];
        for (node, target) in targets {
            body.set_particle_kinematic_target(*node, engine(target));
        }
        self.world.step();
        let body = &self.world.soft_bodies[self.handle];
        for (node, p) in self.nodes.iter_mut().zip(body.particle_positions()) {
            *node = Point3::new(f64::from(p.x), f64::from(p.y), f64::from(p.z)) / DM;
        }
    }

    pub fn pin(&mut self, node: usize, pinned: bool) {
        self.world.soft_bodies[self.handle].set_particle_pinned(node, pinned);
    }

    /// Adds a fixed body beside this one.
    pub fn add_obstacle(&mut self, surface: &TriangleMesh, friction: f64) -> Result<(), SimError> {
        let vertices = surface.vertices.iter().map(engine).collect();
        let triangles = surface.triangles.iter().map(|t| t.map(|v| v as u32));
        let collider = ColliderBuilder::trimesh(vertices, triangles.collect())
            .map_err(|error| SimError::Engine(error.to_string()))?;
        self.world.insert(
            RigidBodyBuilder::fixed(),
            collider.friction(friction as f32),
        );
        Ok(())
    }

    /// Nodes that carry the chosen surface vertices, with their positions.
    pub fn carriers_of(&self, chosen: impl Fn(&Point3<f64>) -> bool) -> Vec<(usize, Point3<f64>)> {
        let surface = self.surface();
        let mut nodes: Vec<usize> = (0..surface.len())
            .filter(|&v| chosen(&surface[v]))
            .flat_map(|v| self.carrier(v).0)
            .collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes.into_iter().map(|n| (n, self.nodes[n])).collect()
    }

    pub fn node(&self, node: usize) -> Point3<f64> {
        self.nodes[node]
    }

    /// Nodes and weights that carry surface vertex `v`.
    pub fn carrier(&self, v: usize) -> &([usize; 4], [f64; 4]) {
        &self.embedding.carriers[v]
    }

    /// World positions of the surface vertices.
    ///
    /// The engine keeps the nodes above the table; the fine surface bulges one or two millimetres beyond the flat faces between
    /// them, and is clamped to the table there.
    pub fn surface(&self) -> Vec<Point3<f64>> {
        let mut surface = self.embedding.place(&self.nodes);
        for p in &mut surface {
            p.z = p.z.max(0.0);
        }
        surface
    }

    /// Speed of the fastest node, m/s.
    pub fn fastest(&self) -> f64 {
        let body = &self.world.soft_bodies[self.handle];
        body.particle_velocities()
            .map(|v| f64::from(v.length()))
            .fold(0.0, f64::max)
            / DM
    }

    /// Volume of the tetrahedra, m³.
    pub fn volume(&self) -> f64 {
        self.tets
            .iter()
            .map(|t| lattice::signed_volume(t.map(|v| self.nodes[v])))
            .sum()
    }

    /// A pinned node that is pulled out of its jaw: its most stretched edge to a free node is too long.
    pub fn slipping(&self, pinned: impl Fn(usize) -> bool) -> Option<usize> {
        let (edge, _) = self
            .edges
            .iter()
            .filter(|([a, b], _)| pinned(*a) != pinned(*b))
            .map(|e| (e.0, self.stretch(e)))
            .filter(|(_, stretch)| *stretch > SLIPS_AT)
            .max_by(|x, y| x.1.total_cmp(&y.1))?;
        edge.into_iter().find(|&node| pinned(node))
    }

    /// Length of an edge divided by its rest length.
    fn stretch(&self, ([a, b], rest): &([usize; 2], f64)) -> f64 {
        (self.nodes[*a] - self.nodes[*b]).norm() / rest
    }

    /// Why the state is invalid, if it is.
    pub fn broken(&self) -> Option<String> {
        if let Some(index) = self
            .nodes
            .iter()
            .position(|p| !p.iter().all(|c| c.is_finite()))
        {
            return Some(format!(
                "node {index} of the soft body is not finite any more"
            ));
        }
        let worst = self
            .edges
            .iter()
            .map(|e| (e.0, self.stretch(e)))
            .max_by(|x, y| x.1.total_cmp(&y.1))?;
        let at = self.nodes[worst.0[0]];
        (worst.1 > MAX_STRETCH).then(|| {
            format!(
                "the object is stretched {:.2} times (at most {MAX_STRETCH}) at {:.3} {:.3} {:.3} m on the table",
                worst.1, at.x, at.y, at.z
            )
        })
    }
}

fn engine(p: &Point3<f64>) -> Vector {
    Vector::new((p.x * DM) as f32, (p.y * DM) as f32, (p.z * DM) as f32)
}

/// Walls whose mean thickness `t = 2 V/A` is smaller are padded to this thickness, metres.
const THINNEST: f64 = 0.010;

/// Largest cell, in thicknesses of the (padded) wall: planes of lattice points, half a cell apart, then always lie
/// within it.
const CELL: f64 = 1.25;

/// Largest relative difference between the volume of the tetrahedra and that of the solid; more means holes.
const MAX_VOLUME_ERROR: f64 = 0.05;

/// Tetrahedra that carry a surface.
struct Filled {
    mesh: TetMesh,
    embedding: Embedding,
    /// How far they extend beyond the surface, metres.
    pad: f64,
}

fn wall(surface: &TriangleMesh) -> f64 {
    2.0 * surface.volume() / surface.area()
}

/// The material with which the padded solid has the weight and the bending stiffness of the wall.
fn padded(material: &Material, surface: &TriangleMesh, mesh: &TetMesh, pad: f64) -> Material {
    if pad == 0.0 {
        return *material;
    }
    let thickness = wall(surface);
    Material {
        density: material.density * surface.volume() / mesh.volume(),
        young: material.young * (thickness / (thickness + 2.0 * pad)).powi(3),
        ..*material
    }
}

/// Tetrahedra of the size that gives the requested number; up to three times as many where the surface is thin.
fn fill(surface: &TriangleMesh, fidelity: &Fidelity) -> Result<Filled, SimError> {
    let distance = surface.signed_distance()?;
    let pad = (0.5 * (THINNEST - wall(surface))).max(0.0);
    let depth = |p: &Point3<f64>| distance.depth(p) + pad;
    let (low, high) = surface.bounds();
    let margin = Vector3::repeat(pad);
    let bounds = (low - margin, high + margin);
    let volume = surface.volume() + pad * surface.area();
    let wanted = fidelity.tetrahedra as f64;
    // Twelve tetrahedra for each cube of the lattice; those cut by the surface come on top, and a first filling counts them.
    let mut cell = (12.0 * volume / wanted).cbrt();
    let first = lattice::fill(&depth, bounds, cell).tets.len();
    cell *= (first.max(1) as f64 / wanted).cbrt().clamp(0.9, 2.0);
    let start = cell.min(CELL * (wall(surface) + 2.0 * pad));
    let most = 3.0 * wanted * (cell / start).powi(3);
    cell = start;
    loop {
        let inscribed = lattice::fill(&depth, bounds, cell);
        // Flat faces cut off bulges. Moved outward by the missing volume over the area, they cross the surface evenly and enclose the right
        // volume.
        let missing = (volume - inscribed.volume()) / surface.area();
        let mesh = lattice::fill(&|p| depth(p) + missing, bounds, cell);
        let whole = (mesh.volume() / volume - 1.0).abs() < MAX_VOLUME_ERROR;
        let enough = mesh.tets.len() as f64 > most;
        let embedding =
            (!mesh.tets.is_empty()).then(|| Embedding::new(&surface.vertices, &mesh, cell));
        match embedding {
            Some(embedding) if whole && embedding.gap <= MAX_GAP * cell => {
                return Ok(Filled {
                    mesh,
                    embedding,
                    pad,
                });
            }
            found if enough => {
                let gap = found.map_or(f64::INFINITY, |e| e.gap);
                return Err(SimError::TooCoarse {
                    tetrahedra: mesh.tets.len(),
                    cell,
                    gap,
                });
            }
            _ => cell *= 0.88,
        }
    }
}

fn builder(mesh: &TetMesh, material: &Material, fidelity: &Fidelity) -> SoftBodyBuilder {
    let mut masses = vec![0.0; mesh.nodes.len()];
    for (t, tet) in mesh.tets.iter().enumerate() {
        let share = 0.25 * material.density * mesh.volume_of(t);
        for &v in tet {
            masses[v] += share;
        }
    }
    let engine_material = SoftBodyMaterial {
        young_modulus: (material.young / DM) as f32,
        poisson_ratio: material.poisson as f32,
        ..SoftBodyMaterial::default()
    };
    SoftBodyBuilder::new(mesh.nodes.iter().map(engine).collect())
        .masses(masses.iter().map(|&m| m as f32).collect())
        .cells(mesh.tets.iter().map(|t| t.map(|v| v as u32)).collect())
        .cell_model(SoftBodyCellModel::Corotational)
        .material(engine_material)
        .self_contacts(fidelity.self_contact)
        .particle_radius((SKIN * DM) as f32)
        .linear_damping(material.damping as f32)
        .surface_collider(
            ColliderBuilder::ball(0.05)
                .friction(material.friction as f32)
                .density(0.0),
        )
}

fn edges(mesh: &TetMesh) -> Vec<([usize; 2], f64)> {
    let mut pairs: Vec<[usize; 2]> = Vec::new();
    for t in &mesh.tets {
        for a in 0..4 {
            for b in a + 1..4 {
                pairs.push([t[a].min(t[b]), t[a].max(t[b])]);
            }
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    let length =
        |[a, b]: [usize; 2]| -> f64 { Vector3::from(mesh.nodes[a] - mesh.nodes[b]).norm() };
    pairs.into_iter().map(|pair| (pair, length(pair))).collect()
}
