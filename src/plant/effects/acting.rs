//! The effects of one axis at work, made from their values once for a plant.
//!
//! Invariant: immutable; what changes from step to step is in [`Remembered`].

use super::super::friction::Law;
use super::super::held_beside;
use super::super::params::Parameters;
use super::catalogue::{Effects, Entry, Values};
use super::hooks::{
    Action, BRISTLES, Bristles, Crossing, Force, Friction, Instant, Memory, Neighbour, Pace, Reading,
};
use crate::base::units::{Force as Newtons, Position, Velocity};

/// Forces of an axis that remember something.
const MEMORIES_MAX: usize = 2;
/// Turns after which a deflection is found: of a zone that is nine tenths soft a hundredth of a per cent is left to find.
const WINDINGS: usize = 90;

/// What the effects of an axis carry from one step to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::plant) struct Remembered {
    /// Since the start, s.
    pub(in crate::plant) time_s: f64,
    /// Forces of the bristles on the table, N, against its way.
    pub(super) bristles_n: [f64; BRISTLES],
    /// Force of the next axis on the table, N.
    pub(super) pushed_n: f64,
    pub(super) forces: [Memory; MEMORIES_MAX],
}

impl Remembered {
    /// Of an axis at rest.
    pub(in crate::plant) const REST: Self =
        Self { time_s: 0.0, bristles_n: [0.0; BRISTLES], pushed_n: 0.0, forces: [[0.0; 2]; MEMORIES_MAX] };
}

/// A force and the number of its memory, if it has one.
#[derive(Debug)]
pub(super) struct Forced {
    pub(super) force: Box<dyn Force>,
    pub(super) memory: Option<usize>,
}

impl Forced {
    /// What it remembers.
    pub(super) fn memory<'r>(&self, all: &'r Remembered) -> &'r Memory {
        const NOTHING: &Memory = &[0.0; 2];
        self.memory.map_or(NOTHING, |number| &all.forces[number])
    }
}

/// The effects of one axis at work.
#[derive(Debug)]
pub(in crate::plant) struct Acting {
    effects: Effects,
    /// A force on the table that is always the same, N.
    pub(super) push_n: f64,
    pub(super) friction: Vec<Box<dyn Friction>>,
    pub(super) forces: Vec<Forced>,
    pub(super) bristles: Option<Bristles>,
    motor_encoder: Vec<Box<dyn Reading>>,
    table_scale: Vec<Box<dyn Reading>>,
    next_axis: Vec<Box<dyn Crossing>>,
}

impl Acting {
    /// The effects of an axis; nothing where its plant has none.
    pub(in crate::plant) fn new(axis: &Parameters) -> Option<Self> {
        let is_of_plant = |(entry, _): (&Entry, &Values)| !entry.is_of_control() && !entry.is_of_base();
        axis.effects.present().any(is_of_plant).then(|| Self::of(axis, axis.effects.present()))
    }

    /// These effects in an axis.
    pub(in crate::plant) fn of<'e>(
        axis: &Parameters,
        effects: impl Iterator<Item = (&'static Entry, &'e Values)>,
    ) -> Self {
        let mut acting = Self {
            effects: axis.effects,
            push_n: axis.effects.push_n(),
            friction: Vec::new(),
            forces: Vec::new(),
            bristles: None,
            motor_encoder: Vec::new(),
            table_scale: Vec::new(),
            next_axis: Vec::new(),
        };
        let mut memories = 0;
        for (entry, values) in effects {
            match entry.action {
                // Is in the parameters already; is taken from all of them; is no matter of the plant.
                Action::Parameter(_) | Action::Push(_) | Action::Control(_) => {}
                Action::Friction(make) => acting.friction.push(make(values, axis)),
                Action::Bristles(make) => acting.bristles = Some(make(values, axis)),
                Action::Force(make) => {
                    let force = make(values, axis);
                    let memory = force.memory(0.0).map(|_| memories);
                    memories += usize::from(memory.is_some());
                    acting.forces.push(Forced { force, memory });
                }
                Action::MotorEncoder(make) => acting.motor_encoder.push(make(values, axis)),
                Action::TableScale(make) => acting.table_scale.push(make(values, axis)),
                Action::NextAxis(make) => acting.next_axis.push(make(values, axis)),
            }
        }
        assert!(memories <= MEMORIES_MAX, "more than {MEMORIES_MAX} forces that remember");
        acting
    }

    /// How fast the forces change while the motor turns at a speed and the table runs; those of bristles tell themselves.
    pub(super) fn pace_at(&self, motor_m_per_s: f64) -> Pace {
        self.forces.iter().map(|forced| forced.force.pace(motor_m_per_s)).max().unwrap_or(Pace::Slow)
    }

    /// By how much friction falls with the speed beyond what the law does, where it falls most, N s/m.
    pub(in crate::plant) fn steepest_fall_n_s_per_m(&self) -> f64 {
        self.friction.iter().map(|friction| friction.steepest_fall_n_s_per_m()).sum()
    }

    /// The parameters that the base model is to be computed with.
    pub(in crate::plant) fn prepared(&self, axis: &Parameters) -> Parameters {
        let mut prepared = *axis;
        for forced in &self.forces {
            forced.force.prepare(&mut prepared);
        }
        prepared
    }

    /// Whether it changes now how the axis moves, and not only what its sensors show.
    pub(in crate::plant) fn moves(&self, all: &Remembered) -> bool {
        let is_loaded = !self.friction.is_empty() || !self.forces.is_empty() || self.bristles.is_some();
        is_loaded || all.pushed_n != 0.0
    }

    /// Whether a step changes what is remembered, but for the time.
    pub(super) fn remembers(&self) -> bool {
        self.bristles.is_some() || self.forces.iter().any(|forced| forced.memory.is_some())
    }

    /// What is remembered in steady sliding, at a friction.
    pub(in crate::plant) fn remembered(&self, velocity_m_per_s: f64, friction_n: f64) -> Remembered {
        let mut all = Remembered { bristles_n: self.bristles_holding(friction_n), ..Remembered::REST };
        for forced in &self.forces {
            if let (Some(number), Some(memory)) = (forced.memory, forced.force.memory(velocity_m_per_s)) {
                all.forces[number] = memory;
            }
        }
        all
    }

    /// As much of a force of the screw as friction holds at a place, where the law alone would hold `breakaway_n`, N.
    pub(in crate::plant) fn held_n(&self, breakaway_n: f64, force_n: f64, place: Position) -> f64 {
        let at = steady(Velocity::ZERO, place, Newtons::n(force_n));
        let other_n = self.on_table_n(&at, &self.remembered(0.0, 0.0));
        let at = Instant { side: (force_n + other_n).signum(), ..at };
        held_beside(other_n, self.friction_n(breakaway_n, &at), force_n)
    }

    /// What is remembered at rest by an axis whose screw pulls its table with a force: bristles hold it, and what else pulls.
    pub(in crate::plant) fn remembered_at_rest(&self, force_n: f64, place: Position) -> Remembered {
        let all = self.remembered(0.0, 0.0);
        let at = steady(Velocity::ZERO, place, Newtons::n(force_n));
        Remembered { bristles_n: self.bristles_holding(force_n + self.on_table_n(&at, &all)), ..all }
    }

    fn bristles_holding(&self, force_n: f64) -> [f64; BRISTLES] {
        self.bristles.map_or([0.0; BRISTLES], |bristles| bristles.holding(force_n))
    }

    /// How far the screw of an axis at rest is deflected by a force, m, beyond the flank that touches.
    pub(in crate::plant) fn wound_up_m(&self, stiffness_n_per_m: f64, force_n: f64, place: Position) -> f64 {
        let bare_m = force_n / stiffness_n_per_m;
        let mut deflection_m = bare_m;
        // `F = K (d + stretch(d))`: a stretch is less than what is deflected, so that this comes to rest.
        for _ in 0..WINDINGS {
            let at = Instant {
                table_m: place.as_m() - deflection_m,
                deflection_m,
                ..steady(Velocity::ZERO, place, Newtons::n(force_n))
            };
            deflection_m = bare_m - self.stretch_m(&at);
        }
        deflection_m
    }

    /// What the screw seems to be deflected more, m.
    pub(super) fn stretch_m(&self, at: &Instant) -> f64 {
        self.forces.iter().map(|forced| forced.force.stretch_m(at)).sum()
    }

    /// What is remembered by an axis that was another until now: all of it if it had the same effects.
    pub(in crate::plant) fn taken_over(&self, before: Option<&Self>, all: &Remembered) -> Remembered {
        match before {
            Some(before) if before.effects == self.effects => *all,
            _ => Remembered { time_s: all.time_s, ..self.remembered(0.0, 0.0) },
        }
    }

    /// Friction in steady sliding at a place of the machine, signed like the velocity, N.
    pub(in crate::plant) fn steady_friction_n(&self, law: &Law, velocity: Velocity, place: Position) -> f64 {
        let at = steady(velocity, place, law.sliding(velocity));
        self.friction_n(law.magnitude_n(at.speed_m_per_s), &at) * at.side
    }

    /// What the screw has to push with for that.
    pub(in crate::plant) fn steady_force(&self, law: &Law, velocity: Velocity, place: Position) -> Newtons {
        let at = steady(velocity, place, law.sliding(velocity));
        let all = self.remembered(velocity.as_m_per_s(), 0.0);
        Newtons::n(self.steady_friction_n(law, velocity, place) - self.on_table_n(&at, &all))
    }

    /// Friction where the law alone would give `even_n`, N.
    pub(in crate::plant) fn friction_n(&self, even_n: f64, at: &Instant) -> f64 {
        let mut factor = 1.0;
        let mut sum_n = even_n;
        for friction in &self.friction {
            let [added_n, by] = friction.both(at);
            sum_n += added_n;
            factor *= by;
        }
        (sum_n * factor).max(0.0)
    }

    /// Forces on the table but those of screw and friction, N.
    pub(in crate::plant) fn on_table_n(&self, at: &Instant, all: &Remembered) -> f64 {
        let of = |forced: &Forced| forced.force.on_table_n(at, forced.memory(all));
        self.forces.iter().map(of).sum::<f64>() + all.pushed_n + self.push_n
    }

    /// What motor encoder and table scale show too much at these places, m.
    pub(in crate::plant) fn reading_errors_m(&self, places_m: [f64; 2], all: &Remembered) -> [f64; 2] {
        let sum = |readings: &[Box<dyn Reading>], place_m: f64| -> f64 {
            readings.iter().map(|reading| reading.error_m(place_m, all.time_s)).sum()
        };
        [sum(&self.motor_encoder, places_m[0]), sum(&self.table_scale, places_m[1])]
    }

    /// The next axis pushes the table as it does now; what the table scale shows too much of it, m.
    pub(in crate::plant) fn crossing_m(&self, other: &Neighbour, all: &mut Remembered) -> f64 {
        all.pushed_n = self.next_axis.iter().map(|crossing| crossing.on_table_n(other)).sum();
        self.next_axis.iter().map(|crossing| crossing.error_m(other)).sum()
    }

    /// Whether the next axis does something to this one.
    pub(in crate::plant) fn is_crossed(&self) -> bool {
        !self.next_axis.is_empty()
    }
}

/// An axis that slides steadily at a place of the machine, its screw pushing with a force.
fn steady(velocity: Velocity, place: Position, force: Newtons) -> Instant {
    let (speed, place_m) = (velocity.as_m_per_s(), place.as_m());
    Instant {
        motor_m: place_m,
        table_m: place_m,
        table_m_per_s: speed,
        deflection_m: 0.0,
        drive_n: force.as_n(),
        screw_n: force.as_n(),
        speed_m_per_s: speed.abs(),
        side: speed.signum(),
        time_s: 0.0,
    }
}
