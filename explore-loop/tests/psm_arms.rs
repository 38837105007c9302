//! Simulated arms with the joints of a dVRK.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use explore_loop::cell::Cell;
use explore_loop::cell::sim::{ArmModel, Scene, SimCell, SimOptions};
use explore_loop::explore::{ExploreOptions, Explorer, Stop};
use explore_loop::plan::CoveragePlanner;

/// Nobody to be told.
struct Nobody;
impl explore_loop::explore::Watcher for Nobody {
    fn event(
        &mut self,
        event: explore_loop::explore::Event<'_>,
        _: &explore_loop::canonical::CanonicalModel,
    ) -> Result<(), explore_loop::Error> {
        use explore_loop::explore::Event;
        match event {
            Event::Planned(plan) => eprintln!(
                "planned {:?} turn {:?}",
                plan.grips
                    .iter()
                    .map(|g| (g.arm, g.vertex))
                    .collect::<Vec<_>>(),
                plan.turn.is_some()
            ),
            Event::Topology(t) => eprintln!("betti {:?} missing {}", t.betti, t.missing),
            Event::Trouble(t) => eprintln!("{t}"),
            Event::Phase(p) => eprintln!("{p:?}"),
            _ => {}
        }
        Ok(())
    }
}

#[test]
fn the_liver_closes_with_the_arms_of_a_dvrk() {
    for seed in 0..3 {
        let mut options = SimOptions::new(Scene::liver().unwrap());
        options.arm_model = ArmModel::Psm;
        options.seed = seed;
        let (mut cell, _truth) = SimCell::new(&options).unwrap();
        for arm in &cell.info().arms {
            eprintln!(
                "{} {}",
                arm.camera_from_home,
                arm.poses.as_ref().unwrap().contains(&arm.camera_from_home)
            );
        }
        let (mut planner, mut nobody) = (CoveragePlanner::default(), Nobody);
        let exploring = ExploreOptions::new(0.005, 0.03);
        let mut explorer = Explorer::new(&mut cell, &mut planner, &mut nobody, exploring).unwrap();
        let outcome = explorer.run().unwrap();
        eprintln!(
            "seed {seed}: {:?} {}",
            outcome.stop.word(),
            outcome.stop.reason().unwrap_or_default()
        );
    }
}
