//! Backlash: play of width `b` between screw and table. Inside the gap neither spring nor damper carries
//! force, and a flank only pushes. It acts in the spring `K` and damper `C` of Eq. (6):
//!
//! ```text
//!   δ = d - c - b/2   where d > c + b/2      F = max(0, K δ + C d')     upper flank
//!   δ = d - c + b/2   where d < c - b/2      F = min(0, K δ + C d')     lower flank
//!                     elsewhere              F = 0                      gap
//! ```
//!
//! `d = x_m - x_t` is the deflection and `c` the middle of the gap, zero where the axis starts. Dead-zone
//! model of Nordin and Gutman (Automatica 38, 2002, pp. 1633-1649), with the clamp that keeps the damper
//! from pulling. Valid for play that is the same all along the travel, without preload or wear; at a hard
//! impact the force starts at `C d'`, a step that no real flank has.
//!
//! Touching and leaving are met by halving the step until it is 1/64 of a fine one.
//! Invariant: the flank is a function of the state alone, so the force takes energy or stores it, and
//! never gives more than was stored.

use super::super::body::{Body, Part};
use super::super::maps::{Motion, StepMaps};
use super::super::params::{Mechanics, Parameters};
use super::catalogue::{Coordinate, Entry, Experiment};
use super::hooks::Action;
use super::parameter::Parameter;
use super::step::Stepping;

pub(super) const ENTRY: Entry = Entry {
    name: "backlash",
    summary: "play between screw and table",
    equation: "no force for |x_m - x_t| < b / 2",
    parameters: &[Parameter::new("width-um", "um", [0.0, 1_000.0], 5.0, 5.0)],
    coordinate: Coordinate::WaySinceReversal,
    experiment: Experiment::SmallReversals,
    aliases: &[],
    law_of: None,
    action: Action::Parameter(|values, axis| axis.mechanics.backlash_m += 1e-6 * values[0]),
};

/// Lengths of step: each is half of the one before.
const LEVELS: usize = 7;

/// The play between screw and table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::plant) struct Gap {
    width_m: f64,
    /// Deflection in the middle of the gap.
    middle_m: f64,
}

/// What carries force between screw and table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Flank {
    Lower,
    None,
    Upper,
}

impl Gap {
    /// A gap with the axis in its middle.
    pub(in crate::plant) const fn new(width_m: f64) -> Self {
        Self { width_m, middle_m: 0.0 }
    }

    /// No play, and no trace of one.
    pub(in crate::plant) fn is_none(self) -> bool {
        self == Self::new(0.0)
    }

    /// The gap with another width. The flank that touches stays where it is and the other one moves, so
    /// that neither position nor force jumps; inside the gap the axis stays inside.
    pub(in crate::plant) fn resized(self, width_m: f64, deflection_m: f64) -> Self {
        let [low_m, high_m] = [-0.5, 0.5].map(|side| self.middle_m + side * self.width_m);
        let half_m = 0.5 * width_m;
        let middle_m = if deflection_m > high_m {
            high_m - half_m
        } else if deflection_m < low_m {
            low_m + half_m
        } else {
            self.middle_m.clamp(deflection_m - half_m, deflection_m + half_m)
        };
        Self { width_m, middle_m }
    }

    /// Deflection at which a flank begins to push; the middle where none does.
    fn rest_m(self, flank: Flank) -> f64 {
        match flank {
            Flank::Lower => self.middle_m - 0.5 * self.width_m,
            Flank::None => self.middle_m,
            Flank::Upper => self.middle_m + 0.5 * self.width_m,
        }
    }

    /// The flank that pushes, and its force on the table, N.
    fn contact(self, motion: &Motion, body: &Body) -> (Flank, f64) {
        let force_n = |flank| {
            let pressed_m = motion[0] - self.rest_m(flank);
            body.stiffness_n_per_m * pressed_m + body.damping_n_s_per_m * (motion[1] - motion[2])
        };
        let is_beyond = |flank| motion[0] - self.rest_m(flank);
        if is_beyond(Flank::Upper) > 0.0 && force_n(Flank::Upper) > 0.0 {
            (Flank::Upper, force_n(Flank::Upper))
        } else if is_beyond(Flank::Lower) < 0.0 && force_n(Flank::Lower) < 0.0 {
            (Flank::Lower, force_n(Flank::Lower))
        } else {
            (Flank::None, 0.0)
        }
    }
}

/// Maps with and without contact, from a fine step down.
#[derive(Clone, Debug)]
pub(in crate::plant) struct Ladder {
    touching: Vec<StepMaps>,
    apart: Vec<StepMaps>,
}

impl Ladder {
    /// The maps of an axis for fine steps of `step_s` seconds and their halves.
    pub(in crate::plant) fn new(axis: &Parameters, step_s: f64) -> Self {
        let loose = Mechanics {
            stiffness_n_per_m: 0.0,
            damping_n_s_per_m: 0.0,
            carried_share: 0.0,
            ..axis.mechanics
        };
        let apart = Parameters { mechanics: loose, ..*axis };
        let steps = |axis: &Parameters| {
            (0..LEVELS).map(|level| StepMaps::new(axis, step_s / f64::from(1_u32 << level))).collect()
        };
        Self { touching: steps(axis), apart: steps(&apart) }
    }

    fn maps(&self, level: usize, flank: Flank) -> &StepMaps {
        match flank {
            Flank::None => &self.apart[level],
            Flank::Lower | Flank::Upper => &self.touching[level],
        }
    }
}

impl Body {
    /// A part of the tick for an axis with play.
    // Out of the way of the axes that have none.
    #[cold]
    #[inline(never)]
    pub(in crate::plant) fn advance_with_gap<S: Stepping>(
        &mut self,
        part: &Part,
        ladder: &Ladder,
        command_n: f64,
        stepping: &S,
    ) {
        let mut done = 0;
        let (maps, length) = part.stride(stepping.pace(self));
        while length > 0 && done + length <= part.fine_steps {
            let before = (self.motion, self.remembered);
            let (flank, _) = self.gap.contact(&self.motion, self);
            if flank == Flank::None {
                break;
            }
            self.motion[0] -= self.gap.rest_m(flank);
            let goes_on = stepping.span(self, maps, command_n);
            self.motion[0] += self.gap.rest_m(flank);
            if !goes_on || self.gap.contact(&self.motion, self).0 != flank {
                (self.motion, self.remembered) = before;
                break;
            }
            done += length;
        }
        for _ in done..part.fine_steps {
            self.step_with_gap(ladder, 0, command_n, stepping);
        }
    }

    /// One step of `ladder` at `level`, halved where screw and table touch or part in it.
    fn step_with_gap<S: Stepping>(&mut self, ladder: &Ladder, level: usize, command_n: f64, stepping: &S) {
        let before = (self.motion, self.slide, self.remembered);
        let touched = self.gap.contact(&self.motion, self);
        let (flank, _) = touched;
        let rest_m = self.gap.rest_m(flank);
        self.motion[0] -= rest_m;
        let stands = stepping.moved(self, ladder.maps(level, flank), command_n);
        self.motion[0] += rest_m;
        let pull_n = |body: &Self, (flank, screw_n), motion: &Motion| match flank {
            Flank::None => 0.0,
            Flank::Lower | Flank::Upper => body.pull_beside_n(screw_n, motion),
        };
        let was = stands.then(|| {
            self.stopped(
                (before.1, &before.0),
                pull_n(self, touched, &before.0),
                ladder.maps(level, flank).length_s,
            )
        });
        let touches = self.gap.contact(&self.motion, self);
        let (flank_after, _) = touches;
        if flank_after != flank && level + 1 < LEVELS {
            (self.motion, self.slide, self.remembered) = before;
            self.step_with_gap(ladder, level + 1, command_n, stepping);
            self.step_with_gap(ladder, level + 1, command_n, stepping);
        } else if let Some(was) = was {
            let deflection_m = self.motion[0] - self.gap.rest_m(flank_after);
            let pulls = (deflection_m, pull_n(self, touches, &self.motion));
            self.break_away(stepping, ladder.maps(level, flank_after), pulls, was);
        }
    }

    /// Force of the screw on the table, N.
    pub(in crate::plant) fn screw_n(&self) -> f64 {
        if self.gap.is_none() {
            let stretch_m_per_s = self.motion[1] - self.motion[2];
            return self.stiffness_n_per_m * self.motion[0] + self.damping_n_s_per_m * stretch_m_per_s;
        }
        self.gap.contact(&self.motion, self).1
    }
}

#[cfg(test)]
mod tests;
