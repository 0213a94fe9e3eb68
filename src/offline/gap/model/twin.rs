//! What a simulation is run with, and the parameters of the base model in it.
//!
//! A parameter is what the machine file says times the exponential of its coordinate in steps of its prior; a zero, of which no file
//! tells, is added. What a current sensor shows too much and where zeros of columns are is of the sensors and fitted beside the
//! plant, so that they are taken for no effect.
//! Invariant: a coordinate of 0 is what the file says.

use crate::base::units::{Force, Velocity};
use crate::offline::gap::measure::forward::{CURRENT, DEFLECTION, FOLLOWING_ERROR};
use crate::plant::Parameters;
use crate::plant::effects::{Entry, Values};

/// The effect of which every guide has some: where a file knows it, it is of the base as friction is.
pub(in crate::offline::gap) const BRISTLES: &str = "presliding";

/// What a simulation is run with.
#[derive(Clone, Copy, Debug)]
pub struct Twin {
    /// The plant.
    pub plant: Parameters,
    /// Current that is shown per current that flows.
    pub current_gain: f64,
    /// What a table scale makes of no deflection but that by a force that is always there, m: where it is half way between both ways.
    pub table_zero_m: f64,
    /// What a following error is shown too large, in steps in which the position is written down.
    pub position_zero_steps: f64,
}

impl Twin {
    /// A plant whose sensors show what there is.
    pub const fn new(plant: Parameters) -> Self {
        Self { plant, current_gain: 1.0, table_zero_m: 0.0, position_zero_steps: 0.0 }
    }

    /// How far the force that is always there keeps the table before the motor, m. Only rows at rest tell that from a zero; with both in one
    /// number neither waits for the other, which a zero that may be anywhere within a count makes up for.
    pub(in crate::offline::gap) fn pushed_apart_m(&self) -> f64 {
        self.plant.effects.push_n() / self.plant.mechanics.stiffness_n_per_m
    }
}

/// A parameter of the base model.
#[derive(Clone, Copy, Debug)]
pub struct Base {
    /// As identification names it.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Standard deviation of the logarithm of how far machine files are off; of the value itself where no file has it.
    pub prior: f64,
    /// Place of the signal in [`SIGNALS`](super::problem::SIGNALS) of which it is the zero, which is of a recording and of no machine.
    pub zero_of: Option<usize>,
    /// Place of the signal that its sensor shows so many times as large.
    pub scale_of: Option<usize>,
    /// Whether it is added to what the file says, which may be nothing.
    is_added: bool,
    /// How far a machine is from its file at most, in priors: further off it is another machine, or it is an effect.
    reach: [f64; 2],
    get: fn(&Twin) -> f64,
    set: fn(&mut Twin, f64),
}

impl Base {
    /// A parameter of a machine file, as far from it as files usually are.
    const fn filed(
        name: &'static str,
        unit: &'static str,
        prior: f64,
        get: fn(&Twin) -> f64,
        set: fn(&mut Twin, f64),
    ) -> Self {
        Self {
            name,
            unit,
            prior,
            zero_of: None,
            scale_of: None,
            is_added: false,
            reach: [-6.0, 6.0],
            get,
            set,
        }
    }

    /// Whether a coordinate is added to the value, and not a power of it.
    fn adds(&self) -> bool {
        self.is_added || self.is_zero()
    }

    /// Whether it is the zero of a recording.
    pub fn is_zero(&self) -> bool {
        self.zero_of.is_some()
    }

    /// Its value.
    pub fn of(&self, twin: &Twin) -> f64 {
        (self.get)(twin)
    }

    /// Moves it to a coordinate from where the file has it.
    pub fn move_to(&self, coordinate: f64, twin: &mut Twin) {
        if coordinate != 0.0 {
            let (value, by) = (self.of(twin), coordinate * self.prior);
            (self.set)(twin, if self.adds() { value + by } else { value * by.exp() });
        }
    }

    /// Whether a coordinate moves anything: a share of what the file says is nothing does not.
    pub fn is_free(&self, filed: &Parameters) -> bool {
        self.adds() || self.of(&Twin::new(*filed)) != 0.0
    }

    /// The coordinate, as far as it may be from the file.
    pub fn within_reach(&self, coordinate: f64) -> f64 {
        let [low, high] = self.reach;
        coordinate.clamp(low, high)
    }

    /// Whether a coordinate is as far from the file as it may be.
    pub fn is_at_reach(&self, coordinate: f64) -> bool {
        self.reach.contains(&coordinate)
    }
}

/// By which law the table of an axis gives way before it slides, if it does.
pub(in crate::offline::gap) fn bristles_of(plant: &Parameters) -> Option<(&'static Entry, &Values)> {
    plant.effects.present().find(|(entry, _)| entry.effect() == BRISTLES)
}

/// The base parameters, in the order of the coordinates.
pub const BASE: [Base; 15] = [
    Base::filed(
        "mass",
        "kg",
        0.25,
        |twin| twin.plant.mechanics.mass_kg,
        |twin, value| twin.plant.mechanics.mass_kg = value,
    ),
    Base::filed(
        "motor_inertia",
        "kg m2",
        0.25,
        |twin| twin.plant.mechanics.inertia_kg_m2,
        |twin, value| twin.plant.mechanics.inertia_kg_m2 = value,
    ),
    Base::filed(
        "stiffness",
        "N/m",
        0.25,
        |twin| twin.plant.mechanics.stiffness_n_per_m,
        |twin, value| twin.plant.mechanics.stiffness_n_per_m = value,
    ),
    Base {
        // Most files say nothing of it, and no screw is without.
        is_added: true,
        reach: [-0.5, 4.0],
        ..Base::filed(
            "carried_inertia",
            "",
            0.03,
            |twin| twin.plant.mechanics.carried_share,
            |twin, value| {
                twin.plant.mechanics.carried_share = value.min(twin.plant.mechanics.carried_share_max());
            },
        )
    },
    Base::filed(
        "damping",
        "N s/m",
        0.5,
        |twin| twin.plant.mechanics.damping_n_s_per_m,
        |twin, value| twin.plant.mechanics.damping_n_s_per_m = value,
    ),
    Base::filed(
        "sliding",
        "N",
        0.25,
        |twin| twin.plant.friction.sliding.as_n(),
        |twin, value| {
            let excess = twin.plant.friction.breakaway / twin.plant.friction.sliding;
            twin.plant.friction.sliding = Force::n(value);
            twin.plant.friction.breakaway = Force::n(value * excess);
        },
    ),
    Base::filed(
        "breakaway_excess",
        "N",
        0.5,
        |twin| (twin.plant.friction.breakaway - twin.plant.friction.sliding).as_n(),
        |twin, value| twin.plant.friction.breakaway = Force::n(twin.plant.friction.sliding.as_n() + value),
    ),
    Base::filed(
        "fall_end",
        "mm/s",
        0.5,
        |twin| twin.plant.friction.fall_end.as_mm_per_s(),
        |twin, value| {
            let share =
                twin.plant.friction.fall_start.as_mm_per_s() / twin.plant.friction.fall_end.as_mm_per_s();
            twin.plant.friction.fall_end = Velocity::mm_per_s(value);
            twin.plant.friction.fall_start = Velocity::mm_per_s(value * share);
        },
    ),
    Base::filed(
        "fall_start",
        "mm/s",
        0.5,
        |twin| twin.plant.friction.fall_start.as_mm_per_s(),
        |twin, value| {
            twin.plant.friction.fall_start =
                Velocity::mm_per_s(value.min(0.95 * twin.plant.friction.fall_end.as_mm_per_s()));
        },
    ),
    Base {
        // A file may be wrong by a factor of two. More than that is `viscous-friction`.
        reach: [-6.0, 3.25],
        ..Base::filed(
            "viscous",
            "N s/m",
            0.25,
            |twin| twin.plant.friction.viscous_n_s_per_m,
            |twin, value| twin.plant.friction.viscous_n_s_per_m = value,
        )
    },
    Base {
        // Slower than that it is `current-loop-lag` or `actuator-delay`.
        reach: [-1.0, 2.0],
        ..Base::filed(
            "current_loop",
            "Hz",
            0.05,
            |twin| twin.plant.actuator.current_loop_hz,
            |twin, value| twin.plant.actuator.current_loop_hz = value,
        )
    },
    Base {
        scale_of: Some(CURRENT),
        ..Base::filed(
            "current_gain",
            "",
            0.1,
            |twin| twin.current_gain,
            |twin, value| twin.current_gain = value,
        )
    },
    Base {
        zero_of: Some(DEFLECTION),
        reach: [f64::NEG_INFINITY, f64::INFINITY],
        ..Base::filed(
            "table_zero",
            "m",
            1e-5,
            |twin| twin.table_zero_m,
            |twin, value| twin.table_zero_m = value,
        )
    },
    // A column that was cut off, and not rounded, is half a step less than what was there.
    Base {
        zero_of: Some(FOLLOWING_ERROR),
        reach: [-2.0, 2.0],
        ..Base::filed(
            "position_zero",
            "steps",
            0.5,
            |twin| twin.position_zero_steps,
            |twin, value| twin.position_zero_steps = value,
        )
    },
    Base {
        // Beyond a factor of two it is `presliding`.
        reach: [-2.75, 2.75],
        ..Base::filed(
            "presliding_way",
            "um",
            0.25,
            |twin| bristles_of(&twin.plant).map_or(0.0, |(_, values)| values[0]),
            |twin, value| {
                let bristles = bristles_of(&twin.plant).map(|(entry, values)| (entry, *values));
                if let Some((entry, [_, second, third])) = bristles {
                    let [low, high] = entry.parameters[0].bounds;
                    twin.plant = twin.plant.with_effect(entry, [value.clamp(low, high), second, third]);
                }
            },
        )
    },
];
