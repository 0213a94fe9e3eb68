//! What moves of an axis, over the parts of a tick.
//!
//! Invariant: a part of a tick in one stride or in fine steps ends in the same place, to what a stride may be off.

use super::drive_filter::Commands;
use super::effects::Pace;
use super::effects::acting::{Acting, Remembered};
use super::effects::backlash::{Gap, Ladder};
use super::effects::step::Stepping;
use super::friction::Law;
use super::maps::{Motion, StepMaps};
use super::params::Parameters;

/// A part of the tick with one held command: its maps in one step and in fine steps.
#[derive(Clone, Debug)]
pub(super) struct Part {
    whole: StepMaps,
    /// For an axis with effects, whose forces may ask for them: half of it and a fifth.
    half: Option<StepMaps>,
    fifth: Option<StepMaps>,
    pub(super) fine: StepMaps,
    pub(super) fine_steps: u32,
    /// Instead of the others, for an axis with play.
    pub(super) with_gap: Option<Ladder>,
}

impl Part {
    pub(super) fn new(
        axis: &Parameters,
        gap: Gap,
        length_s: f64,
        fine_steps: u32,
        has_effects: bool,
    ) -> Self {
        let fine_s = length_s / f64::from(fine_steps);
        let share = |share: u32| {
            let steps = fine_steps / share;
            (has_effects && steps > 1).then(|| StepMaps::new(axis, fine_s * f64::from(steps)))
        };
        Self {
            whole: StepMaps::new(axis, length_s),
            half: share(2),
            fifth: share(5),
            fine: StepMaps::new(axis, fine_s),
            fine_steps,
            with_gap: (!gap.is_none()).then(|| Ladder::new(axis, fine_s)),
        }
    }

    /// The longest step at a pace, in fine ones; none where they are to be fine.
    #[inline(always)]
    pub(super) fn stride<'p>(&'p self, pace: Pace) -> (&'p StepMaps, u32) {
        let share =
            |maps: &'p Option<StepMaps>, share| maps.as_ref().map(|maps| (maps, self.fine_steps / share));
        let fine = (&self.fine, 0);
        match pace {
            Pace::Slow => (&self.whole, self.fine_steps),
            Pace::Even => share(&self.half, 2).unwrap_or(fine),
            Pace::Brisk => share(&self.fifth, 5).unwrap_or(fine),
            Pace::Fast => fine,
        }
    }
}

/// What moves: state and the constants that decide between sticking and sliding.
#[derive(Clone, Debug)]
pub(super) struct Body {
    pub(super) law: Law,
    pub(super) stiffness_n_per_m: f64,
    pub(super) damping_n_s_per_m: f64,
    /// Share of what accelerates the motor before a table that is held, by which it is pushed back.
    pub(super) push_back: f64,
    pub(super) motion: Motion,
    /// -1 or +1 while the table slides, 0 while it sticks.
    pub(super) slide: f64,
    pub(super) gap: Gap,
    /// Where on the machine the plant's zero is, m.
    pub(super) origin_m: f64,
    pub(super) remembered: Remembered,
}

impl Body {
    #[inline(always)]
    pub(super) fn tick<S: Stepping>(
        &mut self,
        (early, late): (Option<&Part>, &Part),
        commands_n: &Commands,
        pieces: usize,
        stepping: &S,
    ) {
        for (part, commands_n) in [early, Some(late)].into_iter().zip(commands_n) {
            let Some(part) = part else { continue };
            for command_n in commands_n.iter().take(pieces) {
                self.advance(part, *command_n, stepping);
            }
        }
    }

    // Out of the way of the axes that have none.
    #[cold]
    #[inline(never)]
    pub(super) fn tick_with_effects(
        &mut self,
        parts: (Option<&Part>, &Part),
        commands_n: &Commands,
        pieces: usize,
        acting: &Acting,
    ) {
        self.tick(parts, commands_n, pieces, acting);
    }

    fn advance<S: Stepping>(&mut self, part: &Part, command_n: f64, stepping: &S) {
        if let Some(ladder) = &part.with_gap {
            return self.advance_with_gap(part, ladder, command_n, stepping);
        }
        let mut done = 0;
        let (maps, length) = part.stride(stepping.pace(self));
        // A step within which it would slow down into the fall of its friction, reverse or break away is taken again in
        // fine ones.
        while length > 0 && done + length <= part.fine_steps && stepping.span(self, maps, command_n) {
            done += length;
        }
        for _ in done..part.fine_steps {
            if stepping.moved(self, &part.fine, command_n) {
                stepping.break_away(self, &part.fine, self.motion[0], self.pull_n(&self.motion));
            }
        }
    }

    /// Whether the table slides fast enough for long steps.
    pub(super) fn is_running(&self) -> bool {
        self.slide != 0.0 && self.law.has_fallen_at(self.table_speed())
    }

    /// After a step of sliding: whether the table has come to stand, which it does where it would turn back.
    #[inline(always)]
    pub(super) fn stands(&mut self) -> bool {
        if self.motion[2] * self.slide > 0.0 {
            return false;
        }
        self.slide = 0.0;
        self.motion[2] = 0.0;
        true
    }

    pub(super) fn table_speed(&self) -> f64 {
        self.motion[2].abs()
    }

    /// What pulls a table at rest, N.
    #[inline(always)]
    pub(super) fn pull_n(&self, motion: &Motion) -> f64 {
        self.pull_beside_n(self.stiffness_n_per_m * motion[0] + self.damping_n_s_per_m * motion[1], motion)
    }

    /// The same by a force of the screw.
    #[inline(always)]
    pub(super) fn pull_beside_n(&self, screw_n: f64, motion: &Motion) -> f64 {
        screw_n - self.push_back * (motion[3] - screw_n)
    }
}
