//! Where the tracking of a recorded session errs: seen and hidden vertices, phase by phase, against the recorded truth.
//!
//! ```sh
//! cargo run --release -p explore-loop --example tracking_error -- SESSION.mcap...
//! ```
//! For every session a table with a line a phase (R at rest, H held on the table, A lifted): mean error of the seen vertices along
//! and across the surface, of the hidden ones, and the shape of the model at the end of the phase, mm.

use explore_loop::canonical::graph;
use explore_loop::cell::replay::ReplayCell;
use explore_loop::cell::{Cell, CellError};
use explore_loop::measure::TrueSurface;
use explore_loop::nalgebra::{Point3, Vector3};
use explore_loop::reconstruct::{ReconstructOptions, Reconstructor};
use parry3d_f64::math::Vector as PV;
use parry3d_f64::query::{PointQuery, PointQueryWithLocation};
use parry3d_f64::shape::TriMesh;
use std::collections::HashMap;
use std::io::Write;

fn mesh(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> TriMesh {
    TriMesh::new(
        vertices.iter().map(|p| PV::new(p.x, p.y, p.z)).collect(),
        triangles.to_vec(),
    )
    .expect("a mesh")
}

fn mean(v: &[f64]) -> f64 {
    1e3 * v.iter().sum::<f64>() / v.len().max(1) as f64
}

fn p95(v: &[f64]) -> f64 {
    let mut s = v.to_vec();
    s.sort_by(f64::total_cmp);
    s.get((s.len().saturating_sub(1)) * 95 / 100)
        .map_or(0.0, |x| 1e3 * x)
}

fn option(name: &str, default: f64) -> f64 {
    std::env::var(name)
        .ok()
        .and_then(|v| v.parse().ok())
        .unwrap_or(default)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut out = std::io::stdout();
    for session in std::env::args().skip(1) {
        run(&session, &mut out)?;
    }
    Ok(())
}

fn run(session: &str, out: &mut impl Write) -> Result<(), Box<dyn std::error::Error>> {
    let frames = dvrk_io::session::read_truth(std::path::Path::new(session))?;
    let truth = TrueSurface::from_points(&frames[0].points)?;
    let rest = mesh(&truth.vertices, &truth.triangles);
    let mut cell = ReplayCell::new(dvrk_io::session::SessionReader::open(session)?)?;
    let mut options = ReconstructOptions::new(0.005);
    let b = options.body;
    options.cell = option("CELL", options.cell);
    options.body = b
        .with_stiffness(option("STIFF", b.stiffness))
        .with_poisson_ratio(option("NU", b.poisson_ratio))
        .with_motion_sigma(option("MOTION", b.motion_sigma))
        .with_momentum(option("MOMENTUM", b.momentum))
        .with_stick_sigma(option("STICK", b.stick_sigma))
        .with_friction(option("MU", b.friction))
        .with_contact_sigma(option("CONTACT", b.contact_sigma))
        .with_touch(option("TOUCH", b.touch))
        .with_steps(option("STEPS", b.steps as f64) as usize)
        .with_presteps(option("PRE", b.presteps as f64) as usize)
        .with_release_steps(option("RSTEPS", b.release_steps as f64) as usize)
        .with_release_frames(option("RFRAMES", b.release_frames as f64) as usize)
        .with_release_stiffness(option("RSTIFF", b.release_stiffness))
        .with_initial_weight(option("GAMMA", b.initial_weight))
        .with_initial_weight_sigma(option("GSIGMA", b.initial_weight_sigma));
    let mut reconstructor = Reconstructor::new(options)?;
    let mut anchors: HashMap<u64, (usize, [f64; 3])> = HashMap::new();
    let (mut phase, mut turn) = ('R', 0);
    let mut rows: Vec<(String, [Vec<f64>; 3])> = vec![];
    let mut held = vec![];
    let (mut ms, mut fusion) = (vec![], vec![]);
    let shape = |r: &Reconstructor| {
        let m = r.model();
        let a: Vec<f64> = m
            .rest
            .iter()
            .map(|p| {
                let q = PV::new(p.x, p.y, p.z);
                (rest.project_local_point(q, false).point - q).length()
            })
            .collect();
        let tree = graph::tree(&m.rest).expect("vertices");
        let b: Vec<f64> = truth
            .vertices
            .iter()
            .map(|p| graph::nearest(&tree, p).1)
            .collect();
        format!(
            "m2t {:.2}/{:.1} far {:.1}%",
            mean(&a),
            p95(&a),
            100.0 * b.iter().filter(|d| **d > 0.005).count() as f64 / b.len() as f64
        )
    };
    writeln!(out, "== {session}")?;
    if std::env::var("INFO").is_ok() {
        let table = cell.info().table;
        let mut heights = vec![];
        let mut volume = 0.0;
        for t in &truth.triangles {
            let [a, b, c] = t.map(|i| truth.vertices[i as usize]);
            let n = (b - a).cross(&(c - a));
            volume += a.coords.dot(&b.coords.cross(&c.coords)) / 6.0;
            if n.normalize().dot(&table.normal) < -0.1 {
                heights.push(table.height(&a));
            }
        }
        heights.sort_by(f64::total_cmp);
        let q = |k: f64| 1e3 * heights[((heights.len() - 1) as f64 * k) as usize];
        let top: Vec<f64> = truth
            .vertices
            .iter()
            .map(|p| 1e3 * table.height(p))
            .collect();
        let size = truth.size();
        writeln!(
            out,
            "  size {:.0} mm volume {:.0} cm3 area {:.0} cm2 top {:.0} mm; bottom heights 10% {:.1} 50% {:.1} 75% {:.1} 90% {:.1} 98% {:.1}; triangles {}",
            1e3 * size,
            1e6 * volume,
            1e4 * truth.area(),
            top.iter().copied().fold(0.0, f64::max),
            q(0.1),
            q(0.5),
            q(0.75),
            q(0.9),
            q(0.98),
            truth.triangles.len()
        )?;
        return Ok(());
    }
    loop {
        let observation = match cell.observe() {
            Ok(o) => o,
            Err(CellError::Ended) => break,
            Err(e) => return Err(e.into()),
        };
        let table = cell.info().table;
        let report = reconstructor.process(&observation, &table)?;
        if report.frame == 0 || report.fused {
            writeln!(out, "  volume {:.0} cm3", 1e6 * reconstructor.volume())?;
        }
        ms.push(report.frame_ms);
        if report.fused {
            fusion.push(report.fusion_ms);
        }
        let holding = observation.arms.iter().any(|a| a.holding);
        let Some(now) = frames
            .iter()
            .find(|f| (f.stamp - observation.stamp).abs() < 0.02)
        else {
            continue;
        };
        let low = now
            .points
            .iter()
            .map(|p| table.height(p))
            .fold(f64::INFINITY, f64::min);
        let next = match (phase, holding, low > 0.004) {
            ('R', true, _) => {
                turn += 1;
                'H'
            }
            ('H', true, true) => 'A',
            ('A', true, false) => 'L',
            (_, false, _) => 'R',
            (p, ..) => p,
        };
        if next != phase && (next == 'H' || next == 'R') || report.fused {
            writeln!(
                out,
                "  {:5.1}s {phase}{turn} end: {} V {} {}",
                observation.stamp,
                shape(&reconstructor),
                reconstructor.model().len(),
                if report.fused { "fused" } else { "" }
            )?;
        }
        phase = next;
        let model = reconstructor.model();
        let live = mesh(&now.points, &truth.triangles);
        for (i, id) in model.ids.iter().enumerate() {
            anchors.entry(*id).or_insert_with(|| {
                let p = model.live[i];
                let (_, (t, l)) =
                    live.project_local_point_and_get_location(PV::new(p.x, p.y, p.z), false);
                (
                    t as usize,
                    l.barycentric_coordinates().unwrap_or([1.0, 0.0, 0.0]),
                )
            });
        }
        let mut e = [vec![], vec![], vec![]];
        let worst = option("WORST", -1.0);
        if (observation.stamp - worst).abs() < 0.04 {
            let mut list: Vec<(f64, usize, Vector3<f64>, Point3<f64>)> = (0..model.len())
                .map(|i| {
                    let (t, w) = anchors[&model.ids[i]];
                    let c = truth.triangles[t].map(|k| now.points[k as usize]);
                    let p =
                        Point3::from(c[0].coords * w[0] + c[1].coords * w[1] + c[2].coords * w[2]);
                    let c0 = truth.triangles[t].map(|k| truth.vertices[k as usize]);
                    let r = Point3::from(
                        c0[0].coords * w[0] + c0[1].coords * w[1] + c0[2].coords * w[2],
                    );
                    ((model.live[i] - p).norm(), i, model.live[i] - p, r)
                })
                .collect();
            list.sort_by(|a, b| b.0.total_cmp(&a.0));
            for a in observation.arms.iter().filter(|a| a.holding) {
                writeln!(
                    out,
                    "   tip {:.0?} height {:.0}",
                    (a.camera_from_tip.translation.vector * 1e3).as_slice(),
                    1e3 * table.height(&Point3::from(a.camera_from_tip.translation.vector))
                )?;
            }
            for (d, i, off, r) in list.iter().step_by(list.len() / 40 + 1) {
                writeln!(
                    out,
                    "   err {:.1} seen {} live {:.0?} h {:.0} off [{:.1} {:.1} {:.1}] true rest {:.0?} model rest off [{:.1} {:.1} {:.1}] born {}",
                    1e3 * d,
                    report.measured[*i],
                    (model.live[*i].coords * 1e3).as_slice(),
                    1e3 * table.height(&model.live[*i]),
                    1e3 * off.x,
                    1e3 * off.y,
                    1e3 * off.z,
                    (r.coords * 1e3).as_slice(),
                    1e3 * (model.rest[*i].x - r.x),
                    1e3 * (model.rest[*i].y - r.y),
                    1e3 * (model.rest[*i].z - r.z),
                    model.born[*i]
                )?;
            }
        }
        for (i, id) in model.ids.iter().enumerate() {
            let (t, w) = anchors[id];
            let c = truth.triangles[t].map(|k| now.points[k as usize]);
            let p = Point3::from(c[0].coords * w[0] + c[1].coords * w[1] + c[2].coords * w[2]);
            let n: Vector3<f64> = (c[1] - c[0]).cross(&(c[2] - c[0])).normalize();
            let d = model.live[i] - p;
            if report.measured[i] {
                e[0].push(n.dot(&d).abs());
                e[1].push((d - n * n.dot(&d)).norm());
            } else {
                e[2].push(d.norm());
            }
        }
        if holding && !e[2].is_empty() {
            held.push(e[2].iter().sum::<f64>() / e[2].len() as f64);
        }
        if std::env::var("FRAMES").is_ok() {
            writeln!(
                out,
                "    {:5.1} {phase}{turn} res {:.2} share {:.2} seen {:.2}/{:.2} hidden {:.2} gamma {:.2} {:.0} ms {}",
                observation.stamp,
                1e3 * report.residual,
                report.overlap,
                mean(&e[0]),
                mean(&e[1]),
                mean(&e[2]),
                reconstructor.weight_over_stiffness().unwrap_or_default().0,
                report.frame_ms,
                report.failure.unwrap_or_default()
            )?;
        }
        let name = format!("{phase}{turn}");
        if rows.last().is_none_or(|r| r.0 != name) {
            rows.push((name, [vec![], vec![], vec![]]));
        }
        let last = &mut rows.last_mut().expect("a phase").1;
        for k in 0..3 {
            last[k].extend(&e[k]);
        }
    }
    reconstructor.consolidate(&cell.info().table)?;
    for (name, e) in &rows {
        writeln!(
            out,
            "  {name}: seen {:.2} along, {:.2} across; hidden {:.2}/{:.1}",
            mean(&e[0]),
            mean(&e[1]),
            mean(&e[2]),
            p95(&e[2])
        )?;
    }
    ms.sort_by(f64::total_cmp);
    writeln!(
        out,
        "  END {}; hidden held {:.2}; gamma {:.2}; frame {:.0}/{:.0} ms, fusion {:.0}; V {}",
        shape(&reconstructor),
        mean(&held),
        reconstructor.weight_over_stiffness().unwrap_or_default().0,
        ms[ms.len() / 2],
        ms[ms.len() * 95 / 100],
        fusion.iter().copied().fold(0.0, f64::max),
        reconstructor.model().len()
    )?;
    Ok(())
}
