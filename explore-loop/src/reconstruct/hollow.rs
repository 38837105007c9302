//! Is the body solid or hollow?
//!
//! Both hypotheses are tracked through the first lift. In every frame each of them predicts, from grips, table and weight alone, where the surface is; what
//! is compared is how far the cloud is from it.
//!
//! ```text
//! ratio     mean error of the hollow prediction / mean error of the solid one; nothing is decided for hollow before 12 held frames and 35 mm of motion
//! losing    hollow, if ratio < 0.8 while less than 95 % of what should be visible of the solid body is matched
//! clear     after 100 mm of motion: hollow, if ratio < 0.4;  solid, if ratio > 1.5
//! end       of the manipulation: hollow, if ratio < 0.7;  solid otherwise
//! ```
//! `frames.csv` of a run has the ratio in `hollow_over_solid`. Why the bounds differ: in the middle of a lift the ratio falls to 0.42 for a solid box whose
//! underside is not known yet, but all of what is visible of it is matched; at the end, with 0.85 instead of 0.7, rigid eggs that slip in the jaws (example
//! `own_robot`) end 1 to 1.5 mm too flat.

/// Least number of held frames and amount of motion, metres, before a body counts as hollow.
const LEAST_FRAMES: usize = 12;
const LEAST_MOTION: f64 = 0.035;
/// Motion from which a clear ratio decides before the end, metres.
const EARLY_MOTION: f64 = 0.1;
/// Ratio below which the body is hollow at the end of a manipulation.
const AT_THE_END: f64 = 0.7;
/// The same while the solid body loses what the camera sees: less than this share is matched.
const WHILE_LOSING: f64 = 0.8;
const LOSING: f64 = 0.95;
/// Clear ratios: hollow below the first, solid above the second.
const CLEAR: [f64; 2] = [0.4, 1.5];

/// What is known of a body that is being moved.
#[derive(Clone, Copy, Debug)]
pub(super) struct Evidence {
    /// Mean error of the hollow prediction over that of the solid one.
    pub ratio: f64,
    /// Share of the visible vertices of the solid body that are matched.
    pub share: f64,
    /// Number of held frames.
    pub held: usize,
    /// How far the body was moved while it was held, metres.
    pub carried: f64,
    /// Whether the manipulation has ended.
    pub end: bool,
}

impl Evidence {
    /// Whether the body is hollow; `None` while that is open.
    pub fn is_hollow(&self) -> Option<bool> {
        let enough = self.held >= LEAST_FRAMES && self.carried >= LEAST_MOTION;
        let [hollow, solid] = CLEAR;
        let clear = self.carried >= EARLY_MOTION && !(hollow..solid).contains(&self.ratio);
        if enough && self.share < LOSING && self.ratio < WHILE_LOSING {
            Some(true)
        } else if self.end || enough && clear {
            Some(enough && self.ratio < AT_THE_END)
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A body that is held long enough, in the middle of a lift.
    const LIFTED: Evidence = Evidence {
        ratio: 1.0,
        share: 1.0,
        held: 14,
        carried: 0.06,
        end: false,
    };

    /// Ratios and shares as they were seen: frames of recordings and runs of which the kind of body is known.
    #[test]
    fn bodies_are_what_they_are() {
        // A solid box in the middle of its lift, a liver, and a bent rod at its end.
        let boxed = Evidence {
            ratio: 0.42,
            carried: 0.15,
            ..LIFTED
        };
        assert_eq!(boxed.is_hollow(), None);
        let liver = Evidence {
            ratio: 0.964,
            share: 0.94,
            ..boxed
        };
        assert_eq!(liver.is_hollow(), None);
        let rod = Evidence {
            ratio: 0.907,
            end: true,
            ..boxed
        };
        assert_eq!(rod.is_hollow(), Some(false));
        // A cap whose walls come into view, before it was moved by 100 mm; and one that is not lost.
        let cap = Evidence {
            ratio: 0.78,
            share: 0.923,
            ..LIFTED
        };
        assert_eq!(cap.is_hollow(), Some(true));
        let cap = Evidence {
            ratio: 0.398,
            ..boxed
        };
        assert_eq!(cap.is_hollow(), Some(true));
        // A rigid egg that slips.
        let egg = Evidence { ratio: 0.8, ..rod };
        assert_eq!(egg.is_hollow(), Some(false));
    }

    #[test]
    fn too_little_motion_leaves_it_open_and_ends_as_solid() {
        let brief = Evidence {
            ratio: 0.3,
            share: 0.5,
            held: 11,
            ..LIFTED
        };
        assert_eq!(brief.is_hollow(), None);
        assert_eq!(Evidence { end: true, ..brief }.is_hollow(), Some(false));
        let still = Evidence {
            held: 14,
            carried: 0.03,
            ..brief
        };
        assert_eq!(still.is_hollow(), None);
    }
}
