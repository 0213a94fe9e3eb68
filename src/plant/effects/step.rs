//! One step of an axis: as the base model has it, or with effects.
//!
//! Both hold the forces over a step, as predicted at its start, and correct them by their mean over the step.
//! With effects these are friction and all further forces on motor and table, of which the base knows the one that is
//! always the same; the forces on the motor do not
//! pass the current loop. What effects remember is advanced over the corrected step.
//! Invariant: with effects that do nothing, a step is that of the base model, to the bit.

use super::super::body::Body;
use super::super::friction::Law;
use super::super::maps::{Map, Motion, StepMaps};
use super::acting::{Acting, Remembered};
use super::hooks::{Instant, Pace};

/// How a body is moved on.
pub(in crate::plant) trait Stepping {
    /// How fast the forces change now.
    fn pace(&self, body: &Body) -> Pace;
    /// Move on by one step if the table slides on, or stands, all along it.
    fn span(&self, body: &mut Body, maps: &StepMaps, command_n: f64) -> bool;
    /// Move on by one step; whether the table stands at its end.
    fn moved(&self, body: &mut Body, maps: &StepMaps, command_n: f64) -> bool;
    /// By how much a standing table that it lets slide is pulled harder than friction can hold, N; `deflection_m` is that of
    /// the screw beyond the flank that touches, `pull_n` its force.
    fn break_away(&self, body: &mut Body, maps: &StepMaps, deflection_m: f64, pull_n: f64) -> Option<f64>;
}

/// Whether friction holds a table that is pulled so at the start of a step and so at its end, and by no more between
/// them than they differ.
#[inline(always)]
fn holds(breakaway_n: f64, start_n: f64, end_n: f64) -> bool {
    start_n.abs().max(end_n.abs()) + (end_n - start_n).abs() < breakaway_n
}

/// Share of what a force at the end of a step was still off by there that makes the step one of third order: `1 + r h + (r h)² / 2 +
/// (r h)³ / 6` of what grows at a rate `r`.
const AGAIN: f64 = 1.0 / 3.0;

/// Bristles that are so near to slipping are no spring.
const BENT: f64 = 1e-3;

/// An axis without effects, but for a force on its table that is always the same, N.
#[derive(Clone, Copy, Debug)]
pub(in crate::plant) struct Bare {
    pub(in crate::plant) push_n: f64,
}

impl Bare {
    /// The state after sliding for one step: friction predicted at its start, corrected by its mean, and once more where it falls.
    // Always: as a call, whose answer goes through memory, a tick takes 25.5 ns instead of 19.5 ns.
    #[inline(always)]
    fn slid(self, body: &Body, map: &Map, command_n: f64) -> Motion {
        let start_n = body.law.magnitude_n(body.table_speed());
        let mut end = map.apply(&body.motion, command_n, start_n * body.slide - self.push_n);
        let end_speed = end[2] * body.slide;
        let slower = end_speed.min(body.table_speed());
        if !body.law.is_flat_above(slower) {
            let end_n = body.law.magnitude_n(end_speed.max(0.0));
            map.correct(&mut end, 0.5 * (end_n - start_n) * body.slide);
            if !body.law.has_fallen_at(slower) {
                let again_n = body.law.magnitude_n((end[2] * body.slide).max(0.0));
                map.correct(&mut end, AGAIN * (again_n - end_n) * body.slide);
            }
        }
        end
    }
}

impl Stepping for Bare {
    #[inline(always)]
    fn pace(&self, body: &Body) -> Pace {
        body.pace()
    }

    #[inline(always)]
    fn span(&self, body: &mut Body, maps: &StepMaps, command_n: f64) -> bool {
        if body.slide == 0.0 {
            let end = maps.stick.apply(&body.motion, command_n, 0.0);
            let [start_n, end_n] = [&body.motion, &end].map(|motion| body.pull_n(motion) + self.push_n);
            let stands_on = holds(body.law.breakaway().as_n(), start_n, end_n);
            if stands_on {
                body.motion = end;
            }
            return stands_on;
        }
        let end = self.slid(body, &maps.slip, command_n);
        let slides_on = body.slides_on(&end);
        if slides_on {
            body.motion = end;
        }
        slides_on
    }

    #[inline(always)]
    fn moved(&self, body: &mut Body, maps: &StepMaps, command_n: f64) -> bool {
        if body.slide == 0.0 {
            body.motion = maps.stick.apply(&body.motion, command_n, 0.0);
            return true;
        }
        body.motion = self.slid(body, &maps.slip, command_n);
        body.stands()
    }

    #[inline(always)]
    fn break_away(&self, body: &mut Body, _maps: &StepMaps, _deflection_m: f64, pull_n: f64) -> Option<f64> {
        body.torn_loose(pull_n + self.push_n, body.law.breakaway().as_n())
    }
}

/// A step.
struct Carried {
    from: Instant,
    end: Motion,
    /// Forces on the table at its start and as predicted at its end, N, against its way.
    table_n: [f64; 2],
    /// Friction of bristles at both ends, where it is known.
    known_n: Option<[f64; 2]>,
}

/// Forces of effects and friction on the two masses, N; that on the table counts against its way.
#[derive(Clone, Copy)]
struct Loads {
    motor_n: f64,
    table_n: f64,
}

impl Acting {
    /// The body at a state of motion, at a time.
    fn instant(
        &self,
        body: &Body,
        [stiffness_n_per_m, damping_n_s_per_m]: [f64; 2],
        motion: &Motion,
        time_s: f64,
    ) -> Instant {
        let [deflection_m, motor_m_per_s, table_m_per_s, drive_n, motor_m] = *motion;
        let side = if self.bristles.is_some() { table_m_per_s.signum() } else { body.slide };
        let place_m = body.origin_m + motor_m;
        Instant {
            motor_m: place_m,
            table_m: place_m - deflection_m,
            table_m_per_s,
            deflection_m,
            drive_n,
            screw_n: stiffness_n_per_m * deflection_m + damping_n_s_per_m * (motor_m_per_s - table_m_per_s),
            speed_m_per_s: (table_m_per_s * side).max(0.0),
            side,
            time_s,
        }
    }

    /// The instant at which a standing table is pulled by a force; `deflection_m` is that of the screw beyond the flank that touches,
    /// `pull_n` its force.
    fn pulled_at(
        &self,
        body: &Body,
        maps: &StepMaps,
        (motion, time_s): (&Motion, f64),
        (deflection_m, screw_n): (f64, f64),
        all_n: f64,
    ) -> Instant {
        let at = self.instant(body, maps.screw(), motion, time_s);
        Instant { deflection_m, screw_n, side: all_n.signum(), ..at }
    }

    /// Whether friction holds the table; bristles hold it by their force and let it move.
    fn is_held(&self, body: &Body) -> bool {
        body.slide == 0.0 && self.bristles.is_none()
    }

    fn loads(&self, body: &Body, maps: &StepMaps, at: &Instant, all: &Remembered) -> Loads {
        let friction_n = match &self.bristles {
            Some(bristles) => bristles.together_n(&all.bristles_n),
            None => self.friction_n(body.law.magnitude_n(at.speed_m_per_s), at) * at.side,
        };
        let mut loads = Loads { motor_n: 0.0, table_n: friction_n - all.pushed_n - self.push_n };
        for forced in &self.forces {
            let [motor_n, table_n, stretch_m] = forced.force.all(at, forced.memory(all));
            let stretch_n = maps.stiffness_n_per_m * stretch_m;
            loads.motor_n += motor_n - stretch_n;
            loads.table_n -= table_n + stretch_n;
        }
        loads
    }

    /// What is remembered, after a step, and the friction of bristles over it, N: what it is known to be, or as at its end.
    fn advance(
        &self,
        all: &mut Remembered,
        (law, known_n): (&Law, Option<[f64; 2]>),
        length_s: f64,
        from: &Instant,
        to: &Instant,
    ) -> Option<[f64; 2]> {
        all.time_s = to.time_s;
        for forced in &self.forces {
            if let Some(number) = forced.memory {
                forced.force.advance(&mut all.forces[number], from, to, length_s);
            }
        }
        let bristles = self.bristles.as_ref()?;
        let as_it_goes = || {
            let side = (to.table_m - from.table_m).signum();
            let sliding_n = |at: &Instant, speed_m_per_s: f64| {
                self.friction_n(law.magnitude_n(speed_m_per_s), &Instant { speed_m_per_s, side, ..*at })
            };
            let [from_m_per_s, to_m_per_s] = [from, to].map(|at| at.table_m_per_s.abs());
            if bristles.slip_at_once() {
                return [sliding_n(to, to_m_per_s); 2];
            }
            // Where it falls, the speed at the end is not foretold as well as its mean.
            if !law.has_fallen_at(from_m_per_s.min(to_m_per_s)) {
                return [sliding_n(to, 0.5 * (from.table_m_per_s + to.table_m_per_s).abs()); 2];
            }
            [sliding_n(from, from_m_per_s), sliding_n(to, to_m_per_s)]
        };
        let ends_n = known_n.unwrap_or_else(as_it_goes);
        bristles.move_by(&mut all.bristles_n, ends_n, to.table_m - from.table_m);
        // For one bristle it is the same to the order of the step at the end that was predicted; many follow at once where the law falls.
        (!bristles.slip_at_once()).then_some(ends_n)
    }

    /// A step with the forces at its start, and as predicted at its end.
    // Most effects remember nothing, and copies of it would be a tenth of their steps.
    #[inline(always)]
    fn carried(&self, body: &Body, maps: &StepMaps, command_n: f64) -> Carried {
        let is_held = self.is_held(body);
        let map = if is_held { &maps.stick } else { &maps.slip };
        let from = self.instant(body, maps.screw(), &body.motion, body.remembered.time_s);
        // What acts on a table that is held moves nothing.
        if self.forces.is_empty() && is_held {
            let end = map.apply(&body.motion, command_n, 0.0);
            let table_n = [0.0 - body.remembered.pushed_n - self.push_n; 2];
            return Carried { from, end, table_n, known_n: None };
        }
        let start = self.loads(body, maps, &from, &body.remembered);
        let mut end = map.apply_loaded(&body.motion, command_n, start.motor_n, start.table_n);
        let predicted = self.instant(body, maps.screw(), &end, from.time_s + maps.length_s);
        let mut known_n = None;
        let mut then = None;
        if self.remembers() {
            let then = then.insert(body.remembered);
            known_n = self.advance(then, (&body.law, None), maps.length_s, &from, &predicted);
        }
        let then = then.as_ref().unwrap_or(&body.remembered);
        let last = self.loads(body, maps, &predicted, then);
        let mut correct = |share: f64, before: &Loads, after: &Loads| {
            let [motor_n, table_n] =
                [after.motor_n - before.motor_n, after.table_n - before.table_n].map(|by_n| share * by_n);
            map.correct_loaded(&mut end, motor_n, table_n);
            end
        };
        let corrected = correct(0.5, &start, &last);
        let slower = (corrected[2] * body.slide).min(body.table_speed());
        if self.bristles.is_none() && !is_held && !body.law.has_fallen_at(slower) {
            let at = self.instant(body, maps.screw(), &corrected, predicted.time_s);
            correct(AGAIN, &last, &self.loads(body, maps, &at, then));
        }
        Carried { from, end, table_n: [start.table_n, last.table_n], known_n }
    }

    /// What is remembered where a step has come from one instant to this motion; nothing where that is what was before, but for the
    /// time.
    #[inline(always)]
    fn then(
        &self,
        body: &Body,
        maps: &StepMaps,
        known_n: Option<[f64; 2]>,
        from: &Instant,
        end: &Motion,
    ) -> Option<Remembered> {
        self.remembers().then(|| {
            let to = self.instant(body, maps.screw(), end, from.time_s + maps.length_s);
            let mut then = body.remembered;
            self.advance(&mut then, (&body.law, known_n), maps.length_s, from, &to);
            then
        })
    }
}

impl Body {
    /// A step of this length with effects is over.
    #[inline(always)]
    fn is_at(&mut self, end: Motion, remembered: Option<Remembered>, length_s: f64) {
        self.motion = end;
        match remembered {
            Some(remembered) => self.remembered = remembered,
            None => self.remembered.time_s += length_s,
        }
    }
}

impl Stepping for Acting {
    fn pace(&self, body: &Body) -> Pace {
        let pace = self.pace_at(body.motion[1]);
        match &self.bristles {
            None => body.pace().max(pace),
            // They hold the table and do not let it stick: nothing happens within a step that they do not tell.
            Some(bristles) => {
                let screw = [body.stiffness_n_per_m, body.damping_n_s_per_m];
                let at = self.instant(body, screw, &body.motion, body.remembered.time_s);
                let sliding_n = self.friction_n(body.law.magnitude_n(at.speed_m_per_s), &at) * at.side;
                let left_n = bristles.together_n(&body.remembered.bristles_n) - sliding_n;
                let are_slipping = left_n.abs() <= BENT * sliding_n.abs();
                if body.is_running() && are_slipping { pace } else { bristles.pace.max(pace) }
            }
        }
    }

    fn span(&self, body: &mut Body, maps: &StepMaps, command_n: f64) -> bool {
        let stands = self.is_held(body);
        let Carried { from, end, table_n: [start_n, last_n], known_n } = self.carried(body, maps, command_n);
        let remembered = self.then(body, maps, known_n, &from, &end);
        let goes_on = if stands {
            let end_s = from.time_s + maps.length_s;
            // Nothing that is held rubs: all that acts on it pulls.
            let [start, end] = [(&body.motion, start_n, from.time_s), (&end, last_n, end_s)].map(
                |(motion, table_n, time_s)| {
                    let pull_n = body.pull_n(motion);
                    let all_n = pull_n - table_n;
                    let at = self.pulled_at(body, maps, (motion, time_s), (motion[0], pull_n), all_n);
                    (all_n, self.friction_n(body.law.breakaway().as_n(), &at))
                },
            );
            holds(start.1.min(end.1), start.0, end.0)
        } else if let Some(bristles) = &self.bristles {
            let end_m_per_s = end[2] * body.slide;
            let does_not_fall =
                !bristles.slip_at_once() || !body.is_running() || body.law.has_fallen_at(end_m_per_s);
            end_m_per_s > 0.0 && does_not_fall
        } else {
            body.slides_on(&end)
        };
        if goes_on {
            body.is_at(end, remembered, maps.length_s);
        }
        goes_on
    }

    fn moved(&self, body: &mut Body, maps: &StepMaps, command_n: f64) -> bool {
        let is_held = self.is_held(body);
        let Carried { from, end, known_n, .. } = self.carried(body, maps, command_n);
        if self.remembers() {
            let to = self.instant(body, maps.screw(), &end, from.time_s + maps.length_s);
            self.advance(&mut body.remembered, (&body.law, known_n), maps.length_s, &from, &to);
        } else {
            body.remembered.time_s += maps.length_s;
        }
        body.motion = end;
        if self.bristles.is_some() {
            // Bristles hold it by their force.
            body.slide = body.motion[2].signum();
            return false;
        }
        is_held || body.stands()
    }

    fn break_away(&self, body: &mut Body, maps: &StepMaps, deflection_m: f64, pull_n: f64) -> Option<f64> {
        let now = (&body.motion, body.remembered.time_s);
        let at = self.pulled_at(body, maps, now, (deflection_m, pull_n), pull_n);
        let stretch_n = maps.stiffness_n_per_m * self.stretch_m(&at);
        let all_n = pull_n + stretch_n + self.on_table_n(&at, &body.remembered);
        let at = Instant { side: all_n.signum(), ..at };
        body.torn_loose(all_n, self.friction_n(body.law.breakaway().as_n(), &at))
    }
}
