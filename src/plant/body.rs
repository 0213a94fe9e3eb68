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
    /// Where forces of effects or the fall of friction may ask for them: half of it and a fifth.
    half: Option<StepMaps>,
    fifth: Option<StepMaps>,
    pub(super) fine: StepMaps,
    pub(super) fine_steps: u32,
    /// Instead of the others, for an axis with play.
    pub(super) with_gap: Option<Ladder>,
}

impl Part {
    pub(super) fn new(axis: &Parameters, gap: Gap, length_s: f64, fine_steps: u32, has_shares: bool) -> Self {
        let fine_s = length_s / f64::from(fine_steps);
        let share = |share: u32| {
            let steps = fine_steps / share;
            (has_shares && steps > 1).then(|| StepMaps::new(axis, fine_s * f64::from(steps)))
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

/// What a table that stands at the end of a step did at its start.
#[derive(Clone, Copy, Debug)]
pub(super) enum Before {
    /// It stood, pulled by so much of the screw, N.
    Stood { pull_n: f64 },
    /// It slid, and has stood for this share of the step.
    Slid { stood: f64 },
}

/// What moves: state and the constants that decide between sticking and sliding.
#[derive(Clone, Debug)]
pub(super) struct Body {
    pub(super) law: Law,
    pub(super) stiffness_n_per_m: f64,
    pub(super) damping_n_s_per_m: f64,
    /// How fast friction changes in each piece of its law.
    pub(super) paces: [Pace; 3],
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
            let (slide, before) = (self.slide, self.motion);
            if stepping.moved(self, &part.fine, command_n) {
                let was = self.stopped((slide, &before), self.pull_n(&before), part.fine.length_s);
                let pulls = (self.motion[0], self.pull_n(&self.motion));
                self.break_away(stepping, &part.fine, pulls, was);
            }
        }
    }

    /// The table comes to stand, where it did not stand before; what it did at the start of the step.
    #[inline(always)]
    pub(super) fn stopped(&mut self, (slide, before): (f64, &Motion), pull_n: f64, length_s: f64) -> Before {
        let was = if slide == 0.0 {
            Before::Stood { pull_n }
        } else {
            let back = self.motion[2];
            let stood = if back == 0.0 { 0.0 } else { back / (back - before[2]) };
            // It has not gone back.
            self.motion[0] += 0.5 * stood * length_s * back;
            Before::Slid { stood }
        };
        self.slide = 0.0;
        self.motion[2] = 0.0;
        was
    }

    /// A standing table tears loose when it is pulled harder than friction can hold: at some time of the step, and has gained speed since.
    pub(super) fn break_away<S: Stepping>(
        &mut self,
        stepping: &S,
        maps: &StepMaps,
        (deflection_m, pull_n): (f64, f64),
        was: Before,
    ) {
        let Some(beyond_n) = stepping.break_away(self, maps, deflection_m, pull_n) else { return };
        let share = match was {
            Before::Slid { stood } => stood,
            // What pulls has grown evenly: half of it in the mean since then.
            Before::Stood { pull_n: before_n } => 0.5 * (beyond_n / (pull_n - before_n)).abs().min(1.0),
        };
        self.motion[2] = share * maps.slip.gained(beyond_n);
    }

    /// Whether the table slides faster than where its friction falls.
    pub(super) fn is_running(&self) -> bool {
        self.slide != 0.0 && self.law.has_fallen_at(self.table_speed())
    }

    /// How fast friction changes now.
    #[inline(always)]
    pub(super) fn pace(&self) -> Pace {
        if self.slide == 0.0 { Pace::Slow } else { self.paces[self.law.piece(self.table_speed()) as usize] }
    }

    /// Whether the table slides on all along a step that ends so, by one piece of its friction where that has bends.
    #[inline(always)]
    pub(super) fn slides_on(&self, end: &Motion) -> bool {
        let speed = end[2] * self.slide;
        let has_no_bends = self.paces == [Pace::Slow; 3];
        speed > 0.0 && (has_no_bends || self.law.piece(speed) == self.law.piece(self.table_speed()))
    }

    /// After a step of sliding: whether the table comes to stand, which it does where it would turn back.
    #[inline(always)]
    pub(super) fn stands(&self) -> bool {
        self.motion[2] * self.slide <= 0.0
    }

    /// A standing table slides the way it is pulled where that is more than friction can hold; by how much more, N.
    #[inline(always)]
    pub(super) fn torn_loose(&mut self, all_n: f64, holds_n: f64) -> Option<f64> {
        (all_n.abs() > holds_n).then(|| {
            self.slide = all_n.signum();
            all_n - holds_n * self.slide
        })
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

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::tests::paper_axis;
    use super::super::{FINE_STEPS, Plant};
    use super::*;
    use crate::base::time::Span;
    use crate::base::units::{Current, Force, Position, Velocity};
    use crate::plant::effects::entry;

    /// An axis whose friction falls by so much between 0.1 and 0.5 mm/s.
    fn falling_by(drop_n: f64) -> Parameters {
        let mut axis = paper_axis();
        axis.friction.breakaway = axis.friction.sliding + Force::n(drop_n);
        axis
    }

    /// Where the table is, um, each half millisecond of two seconds of up to 1 mm/s to and fro, stepped so often in each.
    fn to_and_fro(axis: &Parameters, steps: i64, fine_steps: u32) -> Vec<f64> {
        let speed = Velocity::mm_per_s(1.0);
        let tick = Span::us(500 / steps);
        let mut plant = Plant::sliding_in(axis, tick, fine_steps, speed, Position::ZERO);
        let sliding_a = plant.state().current.as_a();
        let mut place_um = |row: i32| {
            let asked = speed * (TAU * f64::from(row) / 4_000.0).cos();
            let off = asked - plant.state().motor_velocity;
            let current = Current::a(sliding_a * asked.as_m_per_s().signum() + 400.0 * off.as_m_per_s());
            for _ in 0..steps {
                plant.step(current);
            }
            plant.state().table_position.as_um()
        };
        (0..4_000).map(&mut place_um).collect()
    }

    fn apart_um(one: &[f64], other: &[f64]) -> f64 {
        one.iter().zip(other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn a_creeping_table_is_stepped_as_fast_as_its_friction_falls() {
        let pace = |axis: &Parameters, mm_per_s: f64| {
            let (tick, speed) = (Span::us(500), Velocity::mm_per_s(mm_per_s));
            Plant::sliding(axis, tick, speed, Position::ZERO).body.pace()
        };
        // By 177 N within 0.4 mm/s a table of 335 kg grows faster at 2600 /s.
        let by_speed = [0.05, 0.3, 0.6].map(|speed| pace(&falling_by(177.0), speed));
        assert_eq!(by_speed, [Pace::Slow, Pace::Fast, Pace::Slow]);
        let by_drop = [50.0, 15.0, 5.0, 0.0].map(|drop_n| pace(&falling_by(drop_n), 0.3));
        assert_eq!(by_drop, [Pace::Brisk, Pace::Even, Pace::Slow, Pace::Slow]);
        // By 0.86 S / v_s at most.
        let stribeck = entry("stribeck").expect("an effect");
        let falls = falling_by(0.0).with_effect(stribeck, [200.0, 1.0, 2.0]);
        assert_eq!([0.05, 0.3, 0.6].map(|speed| pace(&falls, speed)), [Pace::Brisk, Pace::Brisk, Pace::Slow]);
    }

    #[test]
    fn long_steps_of_a_creeping_table_end_where_fine_ones_do() {
        for (drop_n, most_um) in [(0.0, 1e-4), (15.0, 2e-3), (50.0, 0.01)] {
            let axis = falling_by(drop_n);
            let off_um = apart_um(&to_and_fro(&axis, 1, FINE_STEPS), &to_and_fro(&axis, 50, FINE_STEPS));
            assert!(off_um < most_um, "{off_um} um where it falls by {drop_n} N");
        }
    }

    #[test]
    fn a_table_that_nothing_moves_stands_where_it_is() {
        let mut axis = falling_by(0.0);
        axis.friction = crate::plant::friction::Parameters::NONE;
        let mut plant = Plant::sliding(&axis, Span::us(500), Velocity::ZERO, Position::ZERO);
        for _ in 0..10 {
            plant.step(Current::ZERO);
        }
        assert_eq!((plant.state().table_position, plant.state().current), (Position::ZERO, Current::ZERO));
    }

    #[test]
    fn steps_a_quarter_as_long_are_off_by_a_sixteenth_through_stops_and_tears() {
        let axis = falling_by(176.5);
        let right = to_and_fro(&axis, 100, 4);
        let [coarse, quarter] =
            [10, 40].map(|fine_steps| apart_um(&to_and_fro(&axis, 1, fine_steps), &right));
        // Second order: a sixteenth, and what events leave to chance.
        assert!(coarse < 0.012 && quarter < 0.1 * coarse, "{coarse} and {quarter} um");
    }
}
