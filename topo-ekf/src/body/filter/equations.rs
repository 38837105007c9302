//! Normal equations kept between two steps: their pattern is reused as long as the lattice is unchanged, and a step that fails restores them.

use nalgebra::Matrix3;

use super::BodyFilter;
use super::touch::tangents;
use crate::Error;
use crate::body::elastic::{Elastic, Solved};
use crate::body::frame::BodyReport;

impl BodyFilter {
    /// Makes a change and keeps its normal equations; a change that fails leaves the body unchanged.
    pub(super) fn all_or_nothing(
        &mut self,
        change: impl FnOnce(&mut Self, &mut Elastic) -> Result<(BodyReport, Solved), Error>,
    ) -> Result<BodyReport, Error> {
        let before = self.state.clone();
        let (mut elastic, kept) = self.take_elastic()?;
        let changed = change(self, &mut elastic);
        self.spent += elastic.take_spent();
        match changed {
            Ok((report, solved)) => {
                self.last = Some((elastic, solved));
                Ok(report)
            }
            Err(error) => {
                self.state = before;
                self.give_back(elastic, kept);
                Err(error)
            }
        }
    }

    /// The normal equations of the present lattice, and what must be restored if the step fails.
    pub(super) fn take_elastic(&mut self) -> Result<(Elastic, Kept), Error> {
        match self.last.take() {
            Some((elastic, solved)) if elastic.fits(&self.lattice) => {
                Ok((elastic, Kept::Same(solved)))
            }
            outgrown => match self.new_elastic() {
                Ok(elastic) => Ok((elastic, Kept::Outgrown(outgrown))),
                Err(error) => {
                    self.last = outgrown;
                    Err(error)
                }
            },
        }
    }

    pub(super) fn give_back(&mut self, elastic: Elastic, kept: Kept) {
        self.last = match kept {
            Kept::Same(solved) => Some((elastic, solved)),
            Kept::Outgrown(last) => last,
        };
    }

    pub(super) fn new_elastic(&self) -> Result<Elastic, Error> {
        let [u, v] = tangents(&self.table.normal);
        let normal = self.table.normal.into_inner();
        let frame = Matrix3::from_columns(&[u.into_inner(), v.into_inner(), normal]).transpose();
        Elastic::new(&self.lattice, self.options.poisson_ratio, frame)
    }
}

/// What must be restored if a step fails.
#[allow(clippy::large_enum_variant, reason = "one at a time, on the stack")]
pub(super) enum Kept {
    /// The normal equations of the last step; the pattern is still valid.
    Same(Solved),
    /// Everything of the last step, because the lattice has grown since.
    Outgrown(Option<(Elastic, Solved)>),
}
