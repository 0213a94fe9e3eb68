//! The forces of an axis: drive train, motor, friction, and what hangs on the table.
//! Invariant: a feature that is zero changes no bit of a force.

use super::{
    Axis, CURRENT, Contact, MOTOR, MOTOR_SPEED, Push, SWING, SWING_SPEED, State, TABLE, TABLE_SPEED,
};

/// Damping of the springs of pre-sliding that hold, against the mass on them, share of the critical.
const ELEMENT_DAMPING: f64 = 0.1;
/// Speed at which a tool counts as cutting, m/s.
const CUTTING_SPEED: f64 = 1e-3;

/// The force of the drive train, on the table and as the motor feels it.
#[derive(Clone, Copy)]
pub(super) struct TrainForce {
    /// On the table, N.
    pub(super) force: f64,
    /// On the screw, N at the nominal lead.
    pub(super) reaction: f64,
}

impl Axis {
    /// Spring and damper between screw and table.
    #[inline]
    pub(super) fn train_force(&self, state: &State, t: f64) -> TrainForce {
        let plant = &self.plant;
        let train = &self.features.train;
        let [driver, driver_speed] = [state[self.driver], state[self.driver + 1]];
        if self.is_plain {
            let force = plant.stiffness * (driver - state[TABLE])
                + plant.damping * (driver_speed - state[TABLE_SPEED]);
            return TrainForce { force, reaction: force };
        }
        // The nut's travel: that of the motor with the errors of the lead.
        let scale = train.scale + train.growth.at(t);
        let nut = self.nut(driver, t);
        let ratio = 1.0 + scale + train.pitch.slope(driver);
        let apart = nut - state[TABLE];
        let rate = ratio * driver_speed - state[TABLE_SPEED];
        let (bend, is_in_contact) = self.bend(apart);
        let mut stiffness = plant.stiffness;
        if train.compliance_slope != 0.0 {
            stiffness /= 1.0 + train.compliance_slope * state[TABLE];
        }
        let mut force = stiffness * bend;
        if is_in_contact {
            force += plant.damping * rate;
            // A flank pushes, and never pulls.
            if train.backlash != 0.0 && force * bend < 0.0 {
                force = 0.0;
            }
        }
        TrainForce { force, reaction: force * ratio }
    }

    /// Where the nut is for a place of what drives it; both are zero at home.
    #[inline]
    pub(super) fn nut(&self, driver: f64, t: f64) -> f64 {
        let train = &self.features.train;
        driver + (train.scale + train.growth.at(t)) * driver + train.pitch.from_home(driver)
    }

    /// How far the spring is bent for a distance between nut and table, and whether a flank touches.
    fn bend(&self, apart: f64) -> (f64, bool) {
        let train = &self.features.train;
        let half_play = 0.5 * train.backlash;
        let beyond = apart.abs() - half_play;
        if half_play != 0.0 && beyond <= 0.0 {
            return (0.0, false);
        }
        let bend = beyond.max(0.0).copysign(apart);
        let bend = if half_play == 0.0 { apart } else { bend };
        if train.soft_share == 0.0 {
            return (bend, true);
        }
        // Within the zone a part of the stiffness is missing; outside the spring has its whole slope again.
        let lost = train.soft_share * bend.clamp(-train.soft_half_width, train.soft_half_width);
        (bend - lost, true)
    }

    /// Torque that the motor makes of its current, and without one.
    #[inline]
    pub(super) fn motor_torque(&self, state: &State, t: f64) -> f64 {
        let torque = self.plant.torque_constant * state[CURRENT];
        if self.is_plain {
            return torque;
        }
        let (motor, strange) = (&self.features.motor, &self.features.strange);
        let angle = state[MOTOR] / self.travel_per_rad;
        let shares = 1.0 - motor.saturation * state[CURRENT].abs() + motor.ripple.at(angle);
        let mut torque = torque * shares + motor.disturbance.at(t);
        for wave in &motor.cogging {
            torque += wave.at(angle);
        }
        let [hit, between, width] = strange.hits;
        if hit != 0.0 {
            let from = angle.rem_euclid(between) - 0.5 * between;
            torque -= hit * (-(from / width).powi(2)).exp() * state[MOTOR_SPEED].signum();
        }
        let [tooth, per_turn] = strange.teeth;
        if tooth != 0.0 {
            let turn = angle / std::f64::consts::TAU * per_turn;
            torque += tooth * (2.0 * turn.rem_euclid(1.0) - 1.0);
        }
        torque
    }

    /// What pulls at the table beside screw and friction.
    #[inline]
    pub(super) fn table_force(&self, state: &State, t: f64) -> f64 {
        if self.is_plain {
            return 0.0;
        }
        let (train, strange) = (&self.features.train, &self.features.strange);
        let place = state[TABLE];
        let mut force =
            self.swing_force(state) - train.constant - train.spring * (place - train.spring_centre);
        let [stiffness, limit] = strange.wiper;
        if limit != 0.0 {
            force -= stiffness * (place - self.wiper_at);
        }
        let [bending, _] = strange.chain;
        force -= bending * self.chain;
        let [cutting, hz] = strange.cut;
        if cutting != 0.0 && place > 0.0 && state[TABLE_SPEED].abs() > CUTTING_SPEED {
            let tooth = (std::f64::consts::TAU * hz * t).sin().max(0.0);
            force -= cutting * (0.5 + tooth) * state[TABLE_SPEED].signum();
        }
        let [magnet, distance, reach] = strange.magnets;
        if magnet != 0.0 {
            let from = (place.rem_euclid(distance) - 0.5 * distance) / reach;
            force -= magnet * from * (0.5 * (1.0 - from * from)).exp();
        }
        force
    }

    /// Force of the swinging mass on the table.
    #[inline]
    pub(super) fn swing_force(&self, state: &State) -> f64 {
        let train = &self.features.train;
        if train.swing_mass == 0.0 {
            return 0.0;
        }
        let omega = std::f64::consts::TAU * train.swing_hz;
        let damping = 2.0 * train.swing_damping * omega;
        train.swing_mass * (omega * omega * state[SWING] + damping * state[SWING_SPEED])
    }

    /// What friction must hold while the table stands.
    pub(super) fn force_at_rest(&self, state: &State, t: f64, push: &Push) -> f64 {
        self.train_force(state, t).force + push.force + self.table_force(state, t)
    }

    /// What friction can hold against a force of this sign.
    pub(super) fn break_away(&self, state: &State, t: f64, direction: f64) -> f64 {
        let load = self.features.rubbing.load;
        let carried = if load == 0.0 { 0.0 } else { load * self.train_force(state, t).force.abs() };
        self.dry(state, t, 0.0, direction) + carried
    }

    /// Friction of the moving table, against positive travel, N.
    #[inline]
    pub(super) fn friction(&self, state: &State, t: f64, screw_force: f64) -> f64 {
        let rubbing = &self.features.rubbing;
        let velocity = state[TABLE_SPEED];
        let (direction, speed) = match self.contact {
            Contact::Slip(direction) => (direction, (direction * velocity).max(0.0)),
            _ => (velocity.signum(), velocity.abs()),
        };
        let mut dry = self.dry(state, t, speed, direction);
        if rubbing.load != 0.0 {
            dry += rubbing.load * screw_force.abs();
        }
        let mut wet = self.plant.viscous_friction(speed);
        if rubbing.asymmetry != 0.0 {
            wet *= 1.0 + rubbing.asymmetry * direction;
        }
        wet += rubbing.viscous * speed + rubbing.quadratic * speed * speed;
        if self.contact != Contact::Elastic {
            return direction * (dry + wet);
        }
        let travelled = state[TABLE] - self.state[TABLE];
        // What slips does not ring, and a damper of it would be a drag that real axes do not have.
        let stiffness = dry * self.elements.stiffness(travelled);
        let damping = 2.0 * ELEMENT_DAMPING * (stiffness * self.plant.mass).sqrt();
        dry * self.elements.share(travelled) + direction * wet + damping * velocity
    }

    /// The dry part of the friction in a direction.
    #[inline]
    fn dry(&self, state: &State, t: f64, speed: f64, direction: f64) -> f64 {
        let rubbing = &self.features.rubbing;
        let mut dry = self.plant.dry_friction(speed);
        if !self.rubs_differently {
            return dry;
        }
        if rubbing.stribeck != 0.0 {
            let ratio = speed / rubbing.stribeck_speed;
            dry += rubbing.stribeck
                * match rubbing.stribeck_shape {
                    2 => (-ratio * ratio).exp(),
                    1 => (-ratio).exp(),
                    _ => 1.0 / (1.0 + ratio * ratio),
                };
        }
        let place = state[TABLE];
        let mut share = 1.0 + rubbing.asymmetry * direction + rubbing.place_slope * place;
        share += rubbing.place_wave.at(place) - rubbing.warm.at(t);
        let [height, at, width] = rubbing.place_bump;
        if height != 0.0 {
            share += height * (-((place - at) / width).powi(2)).exp();
        }
        for wave in &rubbing.ripple {
            share += wave.at(state[self.driver] / self.travel_per_rad);
        }
        dry * share.max(0.0)
    }
}
