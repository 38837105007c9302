//! The result as text and as JSON.

use std::io::{self, Write};

use grip_planner::nalgebra::{Point3, Vector3};
use grip_planner::{
    Grip, GripSet, Model, Plan, Ranked, Reason, Refusal, Role, Surface, missing_vector_area,
};
use serde_json::{Value, json};

use crate::arguments::Arguments;

/// The plan of a set of grips, or why there is none.
pub type Judged = Result<Plan, Refusal>;

/// The whole result.
pub struct Answer<'a> {
    pub arguments: &'a Arguments,
    pub surface: &'a Surface,
    pub model: &'a Model<'a>,
    pub ranked: &'a Ranked,
    /// One for each ranked set.
    pub sets: &'a [Judged],
}

impl Answer<'_> {
    pub fn print(&self, out: &mut dyn Write) -> io::Result<()> {
        let surface = self.surface;
        writeln!(
            out,
            "{}: {} vertices known, {} of them in view, {:.1} cm² ({:.0} % of the mesh, which is {})",
            self.arguments.model.display(),
            surface.points().len(),
            self.in_view(),
            1e4 * surface.area(),
            100.0 * surface.area() / surface.whole_area(),
            if surface.is_closed() {
                "closed"
            } else {
                "open"
            },
        )?;
        let m = missing_vector_area(self.model);
        let toward = m.try_normalize(0.0);
        writeln!(
            out,
            "missing vector area {:.1} cm² toward {}",
            1e4 * m.norm(),
            toward.map_or("nowhere".into(), |d| direction(&d))
        )?;
        self.print_candidates(out)?;
        for (rank, (set, plan)) in self.ranked.sets.iter().zip(self.sets).enumerate() {
            print_set(out, rank + 1, set, plan)?;
        }
        writeln!(out, "picture: {}", self.arguments.out.display())
    }

    fn print_candidates(&self, out: &mut dyn Write) -> io::Result<()> {
        let found = &self.ranked.candidates;
        writeln!(
            out,
            "{} candidates, {} other vertices tested:",
            found.accepted.len(),
            found.rejected.len()
        )?;
        for (word, count, (vertex, reason)) in self.rejected() {
            writeln!(
                out,
                "  {count:5} {word:<12} such as vertex {vertex}: {reason}"
            )?;
        }
        Ok(())
    }

    /// Why vertices are not candidates: the keyword, their number, and the first one.
    fn rejected(&self) -> Vec<(&'static str, usize, &(u32, Reason))> {
        let mut words: Vec<(&str, usize, &(u32, Reason))> = Vec::new();
        for rejected in &self.ranked.candidates.rejected {
            let word = rejected.1.word();
            match words.iter_mut().find(|w| w.0 == word) {
                Some(entry) => entry.1 += 1,
                None => words.push((word, 1, rejected)),
            }
        }
        words
    }

    fn in_view(&self) -> usize {
        self.model.visible.iter().filter(|seen| **seen).count()
    }

    pub fn object(&self) -> Value {
        let (surface, found) = (self.surface, &self.ranked.candidates);
        let rejected = self.rejected().into_iter();
        let rejected: serde_json::Map<String, Value> = rejected
            .map(|(word, count, _)| (word.to_owned(), count.into()))
            .collect();
        let sets = self.ranked.sets.iter().zip(self.sets);
        json!({
            "model": self.arguments.model,
            "vertices": surface.points().len(),
            "in_view": self.in_view(),
            "area_m2": surface.area(),
            "mesh_area_m2": surface.whole_area(),
            "closed": surface.is_closed(),
            "missing_vector_area_m2": missing_vector_area(self.model).as_slice(),
            "candidates": found.accepted.len(),
            "rejected": rejected,
            "sets": sets.map(|(set, plan)| set_object(set, plan)).collect::<Vec<_>>(),
            "picture": self.arguments.out,
        })
    }
}

fn print_set(out: &mut dyn Write, rank: usize, set: &GripSet, plan: &Judged) -> io::Result<()> {
    let verdict = match plan {
        Ok(plan) => format!(
            "feasible: {:.1} s to the grips, {:.1} s motion, {:.1} s home, at most {:.0} mm/s",
            plan.reach.duration,
            plan.motion.duration,
            plan.withdraw.duration,
            1e3 * plan.motion.peak_speed()
        ),
        Err(reason) => format!("refused: {reason}"),
    };
    writeln!(
        out,
        "{rank:3}. score {:.3}, coverage {:.3}, suitability {:.3}, lifts {} by {:.0}°; {verdict}",
        set.score,
        set.coverage,
        set.suitability,
        direction(&set.turn.lifted),
        set.turn.angle.to_degrees()
    )?;
    for grip in &set.grips {
        writeln!(
            out,
            "       arm {} {} vertex {:5} at {} mm, approach {}, jaws {}",
            grip.arm,
            role(grip),
            grip.vertex,
            millimetres(&grip.tip()),
            direction(&axis(grip, &Vector3::z())),
            direction(&axis(grip, &Vector3::y())),
        )?;
    }
    Ok(())
}

fn set_object(set: &GripSet, plan: &Judged) -> Value {
    let grip = |grip: &Grip| {
        json!({
            "arm": grip.arm,
            "role": role(grip),
            "vertex": grip.vertex,
            "tip_m": grip.tip().coords.as_slice(),
            "approach": axis(grip, &Vector3::z()).as_slice(),
            "jaws": axis(grip, &Vector3::y()).as_slice(),
        })
    };
    let done = plan.as_ref().ok();
    json!({
        "score": set.score,
        "coverage": set.coverage,
        "suitability": set.suitability,
        "lifted": set.turn.lifted.as_slice(),
        "angle_rad": set.turn.angle,
        "refused": plan.as_ref().err().map(ToString::to_string),
        "reach_s": done.map(|p| p.reach.duration),
        "motion_s": done.map(|p| p.motion.duration),
        "withdraw_s": done.map(|p| p.withdraw.duration),
        "peak_speed_m_s": done.map(|p| p.motion.peak_speed()),
        "grips": set.grips.iter().map(grip).collect::<Vec<_>>(),
    })
}

fn role(grip: &Grip) -> &'static str {
    if grip.role == Role::Lift {
        "lifts"
    } else {
        "holds"
    }
}

/// Direction of an axis of the jaws.
fn axis(grip: &Grip, of_jaws: &Vector3<f64>) -> Vector3<f64> {
    grip.camera_from_tip.rotation * of_jaws
}

fn direction(d: &Vector3<f64>) -> String {
    format!("({:5.2} {:5.2} {:5.2})", d.x, d.y, d.z)
}

fn millimetres(p: &Point3<f64>) -> String {
    format!("({:6.1} {:6.1} {:6.1})", 1e3 * p.x, 1e3 * p.y, 1e3 * p.z)
}
