//! The effects that have a name, with their equations as far as they are numbers; where they act is in `axis`,
//! `controller` and `rig`.
//! Invariant: each kind sets its own features and no other's.

use std::f64::consts::TAU;

use super::{Keys, Shape, friction_torque};
use crate::features::{Features, Growth, Wave};
use crate::plant::Plant;

/// Way from the middle of a run to its end, m: what changes with the place is measured by it.
const REACH: f64 = 0.02;
const UM: f64 = 1e6;

macro_rules! kinds {
    ($($kind:ident $name:literal $max:literal,)*) => {
        /// Kinds of effect that have a name.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Kind { $(#[doc = $name] $kind,)* }

        /// All of them with their names.
        pub const NAMES: &[(Kind, &str)] = &[$((Kind::$kind, $name),)*];

        impl Kind {
            /// Its name.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$kind => $name,)* }
            }

            /// The largest amplitude that could still be met, 1 being a strong case.
            pub const fn amplitude_max(self) -> f64 {
                match self { $(Self::$kind => $max,)* }
            }
        }
    };
}

kinds! {
    ViscousFriction "viscous-friction" 5.0,
    QuadraticDrag "quadratic-drag" 5.0,
    Stribeck "stribeck" 3.0,
    Presliding "presliding" 5.0,
    DirectionAsymmetry "direction-asymmetry" 4.0,
    ConstantForce "constant-force" 2.5,
    SpringLoad "spring-load" 3.0,
    PositionDependentFriction "position-dependent-friction" 2.5,
    LoadDependentFriction "load-dependent-friction" 4.0,
    FrictionWarmUp "friction-warm-up" 2.5,
    ScrewRipple "screw-ripple" 4.0,
    MotorCogging "motor-cogging" 10.0,
    TorqueRipple "torque-ripple" 6.0,
    BallPassRipple "ball-pass-ripple" 8.0,
    TorqueSaturation "torque-saturation" 3.5,
    TorqueDisturbance "torque-disturbance" 10.0,
    ActuatorDelay "actuator-delay" 3.0,
    CurrentLoopLag "current-loop-lag" 4.0,
    Backlash "backlash" 5.0,
    SoftZone "soft-zone" 5.0,
    PositionDependentStiffness "position-dependent-stiffness" 2.5,
    Resonance "resonance" 3.0,
    EncoderEccentricity "encoder-eccentricity" 6.0,
    EncoderInterpolation "encoder-interpolation" 5.0,
    PitchError "pitch-error" 6.0,
    ScaleError "scale-error" 6.0,
    ThermalGrowth "thermal-growth" 6.0,
    Squareness "squareness" 6.0,
    CrossCoupling "cross-coupling" 6.0,
    ServoGainMismatch "servo-gain-mismatch" 3.0,
    CommandFilter "command-filter" 6.0,
    ReversalCompensation "reversal-compensation" 4.0,
}

impl Kind {
    /// Whether it shows at the table scale alone.
    pub(super) fn needs_table(self, shape: &Shape) -> bool {
        match self {
            Self::EncoderEccentricity
            | Self::PitchError
            | Self::ScaleError
            | Self::ThermalGrowth
            | Self::Squareness => true,
            Self::EncoderInterpolation => is_in_scale(shape),
            Self::CrossCoupling => is_tilt(shape),
            _ => false,
        }
    }

    /// Sets its numbers and says them.
    pub(super) fn set(self, size: f64, shape: &Shape, plant: &Plant, own: &mut Features, keys: &mut Keys) {
        match self {
            Self::ViscousFriction
            | Self::QuadraticDrag
            | Self::Stribeck
            | Self::Presliding
            | Self::DirectionAsymmetry
            | Self::PositionDependentFriction
            | Self::LoadDependentFriction
            | Self::FrictionWarmUp
            | Self::ScrewRipple
            | Self::BallPassRipple => self.set_rubbing(size, shape, plant, own, keys),
            Self::MotorCogging
            | Self::TorqueRipple
            | Self::TorqueSaturation
            | Self::TorqueDisturbance
            | Self::ActuatorDelay
            | Self::CurrentLoopLag => self.set_motor(size, shape, plant, own, keys),
            Self::ConstantForce
            | Self::SpringLoad
            | Self::Backlash
            | Self::SoftZone
            | Self::PositionDependentStiffness
            | Self::Resonance
            | Self::PitchError
            | Self::ScaleError
            | Self::ThermalGrowth => self.set_train(size, shape, plant, own, keys),
            _ => self.set_reading_or_loop(size, shape, plant, own, keys),
        }
    }

    fn set_rubbing(self, size: f64, shape: &Shape, plant: &Plant, own: &mut Features, keys: &mut Keys) {
        let rubbing = &mut own.rubbing;
        match self {
            Self::ViscousFriction => {
                rubbing.viscous = size * 0.3 * plant.sliding / 0.05;
                keys.add("viscous-n-s-per-mm", rubbing.viscous * 1e-3);
            }
            Self::QuadraticDrag => {
                rubbing.quadratic = size * 0.2 * plant.sliding / 0.01;
                keys.add("drag-n-s2-per-m2", rubbing.quadratic);
            }
            Self::Stribeck => {
                rubbing.stribeck = size * 0.3 * plant.sliding;
                // Clear of the fall that the file has.
                rubbing.stribeck_speed = shape.between(0, 2.0, 8.0) * plant.fall_end.max(0.5e-3);
                rubbing.stribeck_shape = shape.pick(1, &[2, 1, 0]);
                keys.add("extra-n", rubbing.stribeck);
                keys.add("velocity-mm-per-s", rubbing.stribeck_speed * 1e3);
                keys.choose("law", shape.pick(1, &["gauss", "exponential", "lorentz"]));
            }
            Self::Presliding => {
                rubbing.presliding = size * 10e-6;
                keys.add("way-um", rubbing.presliding * UM);
            }
            Self::DirectionAsymmetry => {
                rubbing.asymmetry = shape.sign * size * 0.15;
                keys.add("asymmetry-percent", rubbing.asymmetry * 100.0);
            }
            Self::PositionDependentFriction => {
                let share = size * 0.3;
                match shape.pick(0, &["slope", "wave", "bump"]) {
                    "slope" => {
                        rubbing.place_slope = shape.sign * share / REACH;
                        keys.add("slope-percent-per-m", rubbing.place_slope * 100.0);
                    }
                    "wave" => {
                        let length = shape.between(1, 15e-3, 40e-3);
                        rubbing.place_wave = wave(share, TAU / length, shape);
                        keys.add("wave-percent", share * 100.0);
                        keys.add("wave-length-mm", length * 1e3);
                    }
                    _ => {
                        let (at, width) =
                            ((2.0 * shape.choices[1] - 1.0) * 6e-3, shape.between(2, 2e-3, 6e-3));
                        rubbing.place_bump = [share, at, width];
                        keys.add("bump-percent", share * 100.0);
                        keys.add("bump-at-mm", at * 1e3);
                        keys.add("bump-width-mm", width * 1e3);
                    }
                }
            }
            Self::LoadDependentFriction => {
                rubbing.load = size * 0.05;
                keys.add("share-percent", rubbing.load * 100.0);
            }
            Self::FrictionWarmUp => {
                let time = shape.between(0, 20.0, 80.0);
                rubbing.warm = Growth { amplitude: size * 0.3, time };
                keys.add("drop-percent", rubbing.warm.amplitude * 100.0);
                keys.add("time-constant-s", time);
            }
            Self::ScrewRipple => {
                let order = shape.pick(0, &[1.0, 1.0, 2.0]);
                rubbing.ripple[0] = wave(size * 0.15, order, shape);
                keys.add("share-percent", size * 15.0);
                keys.add("periods-per-turn", order);
            }
            _ => {
                // Balls that pass: no whole number in a turn.
                let order = shape.pick(0, &[2.0, 3.0, 4.0, 6.0, 8.0]) + 0.25 + 0.5 * shape.choices[1];
                rubbing.ripple[1] = wave(size * 0.04, order, shape);
                keys.add("share-percent", size * 4.0);
                keys.add("periods-per-turn", order);
            }
        }
    }

    fn set_motor(self, size: f64, shape: &Shape, plant: &Plant, own: &mut Features, keys: &mut Keys) {
        let motor = &mut own.motor;
        match self {
            Self::MotorCogging => {
                let order = shape.pick(0, &[6.0, 8.0, 12.0, 18.0, 24.0]);
                let torque = size * 0.05 * friction_torque(plant);
                motor.cogging = [wave(torque, order, shape), wave(0.4 * torque, 2.0 * order, shape)];
                keys.add("torque-nm", torque);
                keys.add("periods-per-turn", order);
                keys.add("second-torque-nm", 0.4 * torque);
            }
            Self::TorqueRipple => {
                let order = shape.pick(0, &[6.0, 8.0, 12.0, 18.0, 24.0]);
                motor.ripple = wave(size * 0.03, order, shape);
                keys.add("share-percent", size * 3.0);
                keys.add("periods-per-turn", order);
            }
            Self::TorqueSaturation => {
                // Measured by the current of a brisk acceleration.
                let brisk = (plant.inertia_total() * 2.0 / plant.travel_per_rad() + friction_torque(plant))
                    / plant.torque_constant;
                motor.saturation = size * 0.15 / brisk;
                keys.add("loss-percent-per-a", motor.saturation * 100.0);
            }
            Self::TorqueDisturbance => {
                let hz = shape.pick(0, &[12.5, 24.7, 50.0, 100.0]) * (0.95 + 0.1 * shape.choices[1]);
                motor.disturbance = wave(size * 0.05 * friction_torque(plant), TAU * hz, shape);
                keys.add("torque-nm", motor.disturbance.amplitude);
                keys.add("frequency-hz", hz);
            }
            Self::ActuatorDelay => {
                motor.delay = size * 0.5e-3;
                keys.add("delay-us", motor.delay * UM);
            }
            _ => {
                motor.lag = size * 0.5e-3;
                keys.add("lag-us", motor.lag * UM);
            }
        }
    }

    fn set_train(self, size: f64, shape: &Shape, plant: &Plant, own: &mut Features, keys: &mut Keys) {
        let train = &mut own.train;
        match self {
            Self::ConstantForce => {
                train.constant = shape.sign * size * 0.3 * plant.sliding;
                // The file counts it along the travel.
                keys.add("force-n", -train.constant);
            }
            Self::SpringLoad => {
                train.spring = size * 0.3 * plant.sliding / REACH;
                train.spring_centre = (2.0 * shape.choices[0] - 1.0) * REACH;
                keys.add("stiffness-n-per-mm", train.spring * 1e-3);
                keys.add("neutral-mm", train.spring_centre * 1e3);
            }
            Self::Backlash => {
                train.backlash = size * 10e-6;
                keys.add("width-um", train.backlash * UM);
            }
            Self::SoftZone => {
                train.soft_share = 0.4 + 0.4 * shape.choices[0];
                train.soft_half_width = size * 3e-6;
                keys.add("softness-percent", train.soft_share * 100.0);
                keys.add("half-width-um", train.soft_half_width * UM);
            }
            Self::PositionDependentStiffness => {
                train.compliance_slope = shape.sign * size * 0.3 / (2.0 * REACH);
                keys.add("slope-percent-per-m", train.compliance_slope * 100.0);
            }
            Self::Resonance => {
                train.swing_mass = size * 0.1 * plant.mass;
                train.swing_hz = shape.between(0, 15.0, 90.0);
                train.swing_damping = shape.between(1, 0.01, 0.05);
                // Of all that moves.
                keys.add("mass-percent", 100.0 * train.swing_mass / (plant.mass + train.swing_mass));
                keys.add("frequency-hz", train.swing_hz);
                keys.add("damping-percent", train.swing_damping * 100.0);
            }
            Self::PitchError => {
                // Mostly by the turn, sometimes slow along the screw.
                let turn = TAU / plant.lead;
                let wave_number = shape.pick(0, &[turn, turn, 2.0 * turn, TAU / 60e-3]);
                train.pitch = wave(size * 5e-6, wave_number, shape);
                keys.add("amplitude-um", train.pitch.amplitude * UM);
                keys.add("period-mm", TAU / wave_number * 1e3);
            }
            Self::ScaleError => {
                train.scale = shape.sign * size * 50e-6;
                keys.add("error-um-per-m", train.scale * UM);
            }
            _ => {
                let time = shape.between(0, 20.0, 80.0);
                train.growth = Growth { amplitude: shape.sign * size * 100e-6, time };
                keys.add("growth-um-per-m", train.growth.amplitude * UM);
                keys.add("time-constant-s", time);
            }
        }
    }

    fn set_reading_or_loop(
        self,
        size: f64,
        shape: &Shape,
        plant: &Plant,
        own: &mut Features,
        keys: &mut Keys,
    ) {
        let (reading, loops) = (&mut own.reading, &mut own.loops);
        match self {
            Self::EncoderEccentricity => {
                reading.motor[0] = wave(size * 3e-6, TAU / plant.lead, shape);
                keys.add("amplitude-um", size * 3.0);
            }
            Self::EncoderInterpolation if is_in_scale(shape) => {
                let period = shape.pick(1, &[20e-6, 40e-6, 200e-6]);
                reading.table = wave(size * 0.01 * period, TAU / period, shape);
                keys.choose("encoder", "table-scale");
                keys.add("amplitude-um", size * 0.01 * period * UM);
                keys.add("period-um", period * UM);
            }
            Self::EncoderInterpolation => {
                let lines = shape.pick(1, &[32.0, 64.0, 128.0, 512.0]);
                let period = plant.lead / lines;
                reading.motor[1] = wave(size * 0.01 * period, TAU / period, shape);
                keys.choose("encoder", "motor-encoder");
                keys.add("amplitude-um", size * 0.01 * period * UM);
                keys.add("period-um", period * UM);
            }
            Self::Squareness => {
                reading.squareness = shape.sign * size * 50e-6;
                keys.add("angle-um-per-m", reading.squareness * UM);
            }
            Self::CrossCoupling if is_tilt(shape) => {
                own.is_crossed_by_inertia = is_of_inertia(shape);
                // What accelerates the other table in a circle is a tenth of what holds it.
                let force = if is_of_inertia(shape) { 0.1 } else { 1.0 } * plant.sliding;
                reading.tilt = shape.sign * size * 2e-6 / force;
                keys.add("compliance-um-per-kn", reading.tilt * UM * 1e3);
            }
            Self::CrossCoupling => {
                own.is_crossed_by_inertia = is_of_inertia(shape);
                own.train.pushed = shape.sign * size * 0.1;
                keys.add("share-percent", own.train.pushed * 100.0);
            }
            Self::ServoGainMismatch => {
                let share = shape.sign * size;
                if shape.choices[0] < 0.7 {
                    loops.position_gain = share * 0.1;
                    keys.add("position-gain-percent", loops.position_gain * 100.0);
                } else {
                    loops.velocity_gain = share * 0.15;
                    keys.add("velocity-gain-percent", loops.velocity_gain * 100.0);
                }
            }
            Self::CommandFilter if shape.choices[0] < 0.6 => {
                loops.filter_time = size * 5e-3;
                keys.add("time-ms", loops.filter_time * 1e3);
                keys.choose("form", "first-order");
            }
            Self::CommandFilter => {
                loops.mean_time = size * 10e-3;
                // Of the first-order filter that is late by as much.
                keys.add("time-ms", 0.5 * loops.mean_time * 1e3);
                keys.choose("form", "mean");
            }
            _ => {
                loops.pulse = size * 0.3 * friction_torque(plant) / plant.torque_constant;
                loops.pulse_time = shape.between(0, 5e-3, 60e-3);
                loops.pulse_is_flat = shape.choices[1] < 0.3;
                keys.add("current-a", loops.pulse);
                keys.add("decay-ms", loops.pulse_time * 1e3);
                keys.choose("form", if loops.pulse_is_flat { "flat" } else { "decay" });
            }
        }
    }
}

/// The interpolation error is that of the scale instead of the motor encoder.
fn is_in_scale(shape: &Shape) -> bool {
    shape.choices[0] < 0.35
}

/// The other axis tilts what carries this scale, instead of pushing this table.
fn is_tilt(shape: &Shape) -> bool {
    shape.choices[0] < 0.5
}

/// What the other axis crosses with accelerates its table; its friction is between both.
fn is_of_inertia(shape: &Shape) -> bool {
    (0.3..0.7).contains(&shape.choices[1])
}

fn wave(amplitude: f64, wave: f64, shape: &Shape) -> Wave {
    Wave { amplitude, wave, phase: shape.phase }
}
