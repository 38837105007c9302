//! Decides whether the surface is closed, and if not, what to do next.

use super::{ClosedBy, Event, Explorer, Halt, Manipulation, Outcome, Phase, State, Stop};
use crate::Error;
use crate::canonical::surface::{triangulate, vertex_areas};
use crate::canonical::topology::{self, Topology};
use crate::cell::Observation;
use crate::plan::{NoPlan, PlanInput};
use grip_planner::Plan;
use nalgebra::{Isometry3, Vector3};

impl Explorer<'_> {
    pub(super) fn decide(&mut self) -> Result<State, Halt> {
        self.enter(Phase::Decide)?;
        let table = self.cell.info().table;
        self.reconstructor.consolidate(&table);
        let topology = self.analyse()?;
        self.tell(Event::Topology(&topology))?;
        self.moves.decide(&topology);
        self.keep_best(&topology);
        let closed = match self.options.closed_by {
            ClosedBy::Surface => topology.is_closed(),
            ClosedBy::BettiNumbers => topology.has_betti_numbers_of_closed(),
        };
        let stop = if closed {
            Stop::Closed
        } else if let Some(but) = self.closed_but(&topology).filter(|but| match but {
            Stop::ClosedButTouching(_) => self.moves.parted_in_vain(),
            _ => self.moves.in_vain(),
        }) {
            but
        } else if self.manipulations >= self.options.max_manipulations {
            Stop::TooManyManipulations
        } else if self.misses >= self.options.max_misses {
            Stop::GraspFailed
        } else {
            match self.plan(&topology)? {
                Ok(plan) => {
                    if plan.turn.is_none() && topology.wholly_seen && !topology.neck.is_empty() {
                        self.reconstructor.divide();
                    }
                    self.tell(Event::Planned(&plan))?;
                    let rest = self.reconstructor.model().rest();
                    let at = |g: &grip_planner::Grip| rest.get(g.vertex as usize).copied();
                    let at_rest = plan
                        .grips
                        .iter()
                        .map(|g| at(g).unwrap_or_else(|| g.tip()))
                        .collect();
                    self.guard.pause();
                    return Ok(State::Reach(Box::new(Manipulation { plan, at_rest })));
                }
                Err(reason) => Stop::NothingToGrip(reason),
            }
        };
        Ok(self.done_with(stop, topology)?)
    }

    pub(super) fn analyse(&self) -> Result<Topology, Error> {
        let (spacing, genus) = (self.options.spacing, self.options.genus);
        Ok(topology::analyse_as(
            self.reconstructor.model(),
            spacing,
            genus,
        )?)
    }

    fn plan(&mut self, topology: &Topology) -> Result<Result<Plan, NoPlan>, Error> {
        let model = self.reconstructor.model();
        let mut visible = match &self.latest {
            Some(observation) => self
                .reconstructor
                .visible_now(observation, self.options.spacing),
            None => vec![false; model.len()],
        };
        let all = visible.clone();
        let slippery = self.slips.slippery(model, self.options.spacing);
        let both = visible.iter_mut().zip(slippery);
        both.for_each(|(visible, slippery)| *visible &= !slippery);
        let triangles = triangulate(model.rest(), model.rest_normals(), self.options.spacing);
        // A piece that was not seen turns with the nearest vertex.
        let turned = |h: &topology::Hidden| model.rotations()[h.vertex as usize] * h.area;
        let hidden: Vec<_> = topology.hidden.iter().map(turned).collect();
        let neck = topology.neck.iter().map(|v| model.rotations()[*v as usize]);
        let area = topology.handles.creased_area();
        let neck_area = neck.map(|rotation| rotation * area).sum::<Vector3<f64>>();
        let input = PlanInput {
            points: model.live(),
            normals: &model.live_normals(),
            areas: &vertex_areas(model.live(), &triangles),
            edges: model.edges(),
            topology,
            visible: &visible,
            hidden: &hidden,
            neck_area: neck_area / topology.neck.len().max(1) as f64,
            camera: self.camera(),
            cell: self.cell.info(),
            limits: self.options.limits,
            attempt: self.manipulations + self.misses,
        };
        match self.planner.plan(&input)? {
            Err(_) if visible != all => self.planner.plan(&PlanInput {
                visible: &all,
                ..input
            }),
            planned => Ok(planned),
        }
    }

    /// Pose of the camera in the last frame.
    pub(super) fn camera(&self) -> Isometry3<f64> {
        let latest = self.latest.as_ref();
        latest.map_or_else(Isometry3::identity, Observation::fixed_from_camera)
    }

    /// The end of the exploration, with the topology of the model.
    pub(super) fn done(&mut self, stop: Stop) -> Result<State, Error> {
        if self.reconstructor.model().is_empty() {
            return Err(Error::NothingToSee {
                points: 0,
                needed: 20,
            });
        }
        let topology = self.analyse()?;
        self.done_with(stop, topology)
    }

    /// The place that no manipulation could show, if the surface is closed but for that.
    fn closed_but(&self, topology: &Topology) -> Option<Stop> {
        let held = self.held(topology).map(Stop::ClosedButAttached);
        held.or_else(|| topology.touching().map(Stop::ClosedButTouching))
    }

    fn done_with(&mut self, stop: Stop, topology: Topology) -> Result<State, Error> {
        let (topology, model_of) = self.restore_best(topology)?;
        // If the surface is closed except for a part that cannot be shown, that is the reason to stop.
        let stop = match stop {
            Stop::TooManyManipulations | Stop::NothingToGrip(_) | Stop::GraspFailed => {
                self.closed_but(&topology).unwrap_or(stop)
            }
            stop => stop,
        };
        Ok(State::Done(Box::new(Outcome {
            stop,
            manipulations: self.manipulations,
            troubles: self.troubles.clone(),
            topology,
            model_of,
            stiffness_over_weight: self.reconstructor.stiffness_over_weight(),
        })))
    }
}
