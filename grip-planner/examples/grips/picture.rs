//! The plan as the camera sees it, as SVG.

use std::fmt::Write as _;

use grip_planner::nalgebra::{Point3, UnitVector3, Vector3};
use grip_planner::{Plan, Ranked, Role, Scene, Surface};

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 700.0;
const MARGIN: f64 = 90.0;
/// One colour for each arm.
const ARMS: [&str; 3] = ["#d62728", "#1f5fbf", "#7a3fa0"];

/// Draws the known surface with its coverage, the candidates, the grips of the plan and the paths of their tips.
pub fn draw(surface: &Surface, scene: &Scene, ranked: &Ranked, plan: Option<&Plan>) -> String {
    let tips = plan.map_or(Vec::new(), tips);
    let view = View::new(scene, surface, &tips);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" font-size=\"14\">\n\
         <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fcfcfa\"/>\n"
    );
    let coverage = match (plan, ranked.sets.first()) {
        (Some(plan), _) => plan.coverage_map.clone(),
        (None, Some(set)) => ranked.coverage.map(&set.vertices()).unwrap_or_default(),
        _ => Vec::new(),
    };
    triangles(&mut svg, surface, scene, &view, &coverage);
    for c in &ranked.candidates.accepted {
        let [x, y] = view.at(&c.point);
        let fill = if c.boundary { "#222" } else { "none" };
        let _ = writeln!(
            svg,
            "<circle class=\"candidate\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.2\" fill=\"{fill}\" stroke=\"#222\"/>"
        );
    }
    if let Some(plan) = plan {
        ways(&mut svg, plan, &view);
        grips(&mut svg, plan, scene, &view);
    }
    legend(&mut svg, ranked, plan);
    svg.push_str("</svg>\n");
    svg
}

/// The paths of the tips while they hold, one list for each arm.
fn tips(plan: &Plan) -> Vec<Vec<Point3<f64>>> {
    let tip = |k: &grip_planner::Keyframe| Point3::from(k.camera_from_tip.translation.vector);
    let way = |path: &grip_planner::ArmPath| {
        let held = path.keyframes.iter().filter(|k| k.time <= path.release);
        held.map(tip).collect()
    };
    plan.motion.arms.iter().map(way).collect()
}

/// A pinhole camera that looks at the centre of the body, fitted to the picture.
struct View {
    camera: Point3<f64>,
    axes: [UnitVector3<f64>; 3],
    low: [f64; 2],
    scale: f64,
}

impl View {
    fn new(scene: &Scene, surface: &Surface, tips: &[Vec<Point3<f64>>]) -> Self {
        let (middle, _) = crate::extent::extent(surface.points());
        let forward =
            UnitVector3::try_new(middle - scene.camera, 1e-12).unwrap_or(-scene.table.normal);
        // The picture's x axis is horizontal; for a camera straight above, it is one of the table's axes.
        let level = scene.table.normal.cross(&forward);
        let right = UnitVector3::try_new(-level, 1e-6).unwrap_or(scene.table.axes()[0]);
        let down = UnitVector3::new_normalize(forward.cross(&right));
        let mut view = Self {
            camera: scene.camera,
            axes: [right, down, forward],
            low: [0.0; 2],
            scale: 1.0,
        };
        let all: Vec<[f64; 2]> = surface
            .points()
            .iter()
            .chain(tips.iter().flatten())
            .map(|p| view.project(p))
            .collect();
        let fold =
            |k: usize, f: fn(f64, f64) -> f64, from: f64| all.iter().map(|p| p[k]).fold(from, f);
        let low = [0, 1].map(|k| fold(k, f64::min, f64::INFINITY));
        let high = [0, 1].map(|k| fold(k, f64::max, f64::NEG_INFINITY));
        let room = [WIDTH - 2.0 * MARGIN, HEIGHT - 2.0 * MARGIN];
        let fit = |k: usize| room[k] / (high[k] - low[k]).max(1e-12);
        view.scale = fit(0).min(fit(1));
        view.low = low;
        view
    }

    fn project(&self, p: &Point3<f64>) -> [f64; 2] {
        let d = p - self.camera;
        // Points beside or behind the camera are drawn at the edge.
        let depth = self.axes[2].dot(&d).max(1e-3);
        [self.axes[0].dot(&d) / depth, self.axes[1].dot(&d) / depth]
    }

    fn at(&self, p: &Point3<f64>) -> [f64; 2] {
        let q = self.project(p);
        [0, 1].map(|k| MARGIN + self.scale * (q[k] - self.low[k]))
    }
}

/// Far triangles first; bright where they face the camera, orange where the grips command them.
fn triangles(svg: &mut String, surface: &Surface, scene: &Scene, view: &View, coverage: &[f64]) {
    let mut order: Vec<(f64, &[u32; 3])> = surface
        .triangles()
        .iter()
        .map(|t| {
            let sum: Vector3<f64> = t.iter().map(|&v| surface.points()[v as usize].coords).sum();
            ((sum / 3.0 - scene.camera.coords).norm(), t)
        })
        .collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0));
    let share = |v: u32| coverage.get(v as usize).copied().unwrap_or(0.0);
    for (_, t) in order {
        let [a, b, c] = t.map(|v| surface.points()[v as usize]);
        let normal = (b - a)
            .cross(&(c - a))
            .try_normalize(0.0)
            .unwrap_or_else(Vector3::zeros);
        let toward = (scene.camera - a).normalize();
        let light = 0.55 + 0.45 * normal.dot(&toward).abs();
        // The square root makes small shares visible.
        let warm = (t.iter().map(|&v| share(v)).sum::<f64>() / 3.0).sqrt();
        let mix = |cold: f64, hot: f64| (light * (cold + (hot - cold) * warm)) as u8;
        let fill = format!(
            "#{:02x}{:02x}{:02x}",
            mix(196.0, 255.0),
            mix(208.0, 120.0),
            mix(220.0, 20.0)
        );
        let corners: Vec<String> = [a, b, c]
            .iter()
            .map(|p| view.at(p))
            .map(|[x, y]| format!("{x:.1},{y:.1}"))
            .collect();
        let _ = writeln!(
            svg,
            "<polygon points=\"{}\" fill=\"{fill}\" stroke=\"{fill}\" stroke-width=\"0.5\"/>",
            corners.join(" ")
        );
    }
}

fn ways(svg: &mut String, plan: &Plan, view: &View) {
    for (path, way) in plan.motion.arms.iter().zip(tips(plan)) {
        let points: Vec<String> = way
            .iter()
            .map(|p| view.at(p))
            .map(|[x, y]| format!("{x:.1},{y:.1}"))
            .collect();
        let _ = writeln!(
            svg,
            "<polyline class=\"way\" points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2\" stroke-dasharray=\"6 4\"/>",
            points.join(" "),
            ARMS[path.arm % ARMS.len()]
        );
    }
}

/// The tool back to its wrist, the open jaws, and the number of the arm.
fn grips(svg: &mut String, plan: &Plan, scene: &Scene, view: &View) {
    for grip in &plan.grips {
        let color = ARMS[grip.arm % ARMS.len()];
        let part = |x: f64, y: f64, z: f64| view.at(&(grip.camera_from_tip * Point3::new(x, y, z)));
        let lines = [
            (part(0.0, 0.0, 0.0), part(0.0, 0.0, -scene.shaft_length)),
            (
                part(0.0, -scene.jaw_radius, 0.0),
                part(0.0, scene.jaw_radius, 0.0),
            ),
        ];
        for ([x1, y1], [x2, y2]) in lines {
            let _ = writeln!(
                svg,
                "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"{color}\" stroke-width=\"4\" stroke-linecap=\"round\"/>"
            );
        }
        let [x, y] = lines[0].1;
        let what = if grip.role == Role::Lift {
            "lifts"
        } else {
            "holds"
        };
        let _ = writeln!(
            svg,
            "<text class=\"grip\" x=\"{x:.1}\" y=\"{:.1}\" fill=\"{color}\">arm {} {what}</text>",
            y - 6.0,
            grip.arm
        );
    }
}

fn legend(svg: &mut String, ranked: &Ranked, plan: Option<&Plan>) {
    let line = match plan {
        Some(plan) => format!(
            "coverage {:.3} (orange: commanded by the grips), score {:.3}, {:.1} s at most {:.0} mm/s",
            plan.coverage,
            plan.score,
            plan.motion.duration,
            1e3 * plan.motion.peak_speed()
        ),
        None => "every set was rejected".to_owned(),
    };
    let _ = writeln!(
        svg,
        "<text x=\"20\" y=\"28\">{line}</text>\n<text x=\"20\" y=\"48\" fill=\"#555\">{} candidates: dots on the boundary, rings on the outline; dashed: the paths of the tips</text>",
        ranked.candidates.accepted.len()
    );
}
