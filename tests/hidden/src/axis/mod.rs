//! One axis as equations of motion, in travel of the axis and SI units, at steps of RK4.
//!
//! ```text
//!   i' = 2 pi f (i_command - i)                          current loop
//!   J/r x_m'' = K_t i + T - (r/eta) F                    motor and screw; r: travel per radian
//!   M x_t'' = F - friction + others,  F = k d + c d'     table; d = x_m - x_t
//! ```
//!
//! A share `s` of `J` may sit within the spring, half of its compliance on either side: the screw, at `x_s`, drives the
//! table by twice the spring and is driven by as much.
//!
//! ```text
//!   (1-s) J/r x_m'' = K_t i + T - (r/eta) W,  W = 2 k (x_m - x_s) + 2 c (x_m' - x_s')
//!   s J/r x_s'' = (r/eta) (W - F)             d = x_s - x_t, 2 k, 2 c
//! ```
//!
//! The table sticks or slips. Which one is a state, and the instant at which it changes is found by bisection of the
//! step: a slip ends where the speed passes zero, and goes on at once if the forces do not balance within the
//! break-away force; a stick ends where they pass it. Between two such instants the equations are smooth. With
//! pre-sliding there is no stick: see [`elements`].
//! Invariant: a step ends at its end, however many changes are in it, and never in a slip against its own direction.

pub mod elements;
mod forces;

use elements::Elements;

use crate::features::Features;
use crate::plant::Plant;

/// Motor place and speed, table place and speed, current, current ahead of its loop, swing and its speed, screw place and
/// speed.
pub type State = [f64; 10];
/// Place of the motor, as travel.
pub const MOTOR: usize = 0;
/// Speed of the motor, as travel.
pub const MOTOR_SPEED: usize = 1;
/// Place of the table.
pub const TABLE: usize = 2;
/// Speed of the table.
pub const TABLE_SPEED: usize = 3;
/// Current.
pub const CURRENT: usize = 4;
const LAGGING: usize = 5;
const SWING: usize = 6;
const SWING_SPEED: usize = 7;
const SCREW: usize = 8;
const SCREW_SPEED: usize = 9;

/// Halvings of a step until a change is found: 20 us to 10 ps.
const HALVINGS: usize = 21;
/// Changes within a step beyond which it is taken as it is.
const CHANGES_MAX: usize = 8;

/// What the table does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Contact {
    /// It stands.
    Stick,
    /// It moves in this direction, 1 or -1.
    Slip(f64),
    /// It hangs in the bristles of pre-sliding.
    Elastic,
}

/// What comes from outside and is constant over a step.
#[derive(Clone, Copy, Debug, Default)]
pub struct Push {
    /// Current that is asked for, A.
    pub current: f64,
    /// Torque at the motor, N m.
    pub torque: f64,
    /// Force on the table, N.
    pub force: f64,
}

/// Plant and features of the half of the spring that is behind the screw, so that both halves together are the whole.
fn behind_the_screw(plant: &Plant, features: &Features) -> (Plant, Features) {
    let (mut plant, mut features) = (*plant, *features);
    plant.stiffness *= 2.0;
    plant.damping *= 2.0;
    let train = &mut features.train;
    // The half ahead of it gives as much as without the zone.
    train.soft_half_width *= 0.5 * (1.0 + train.soft_share);
    train.soft_share *= 2.0 / (1.0 + train.soft_share);
    train.compliance_slope *= 2.0;
    (plant, features)
}

/// An axis and where it is.
#[derive(Clone, Debug)]
pub struct Axis {
    plant: Plant,
    features: Features,
    /// Nothing of drive train, motor and the strange is set, which is most of the time.
    is_plain: bool,
    /// Something of the friction is set.
    rubs_differently: bool,
    travel_per_rad: f64,
    torque_per_force: f64,
    /// Acceleration of motor and screw as travel per torque, of the table per force.
    motor_mobility: f64,
    screw_mobility: f64,
    table_mobility: f64,
    /// What drives the nut, [`MOTOR`] or [`SCREW`]; its speed is the next number.
    driver: usize,
    current_rate: f64,
    state: State,
    contact: Contact,
    elements: Elements,
    /// Where the cover hangs, and how far the chain is bent.
    wiper_at: f64,
    chain: f64,
}

impl Axis {
    /// At rest at `t`, the motor at a place and the table without tension behind it.
    pub fn new(plant: &Plant, features: &Features, place: f64, t: f64) -> Self {
        let Features { train, motor, strange, .. } = features;
        let has_screw = plant.screw_share > 0.0;
        let (plant, features) =
            if has_screw { behind_the_screw(plant, features) } else { (*plant, *features) };
        let elements = Elements::new(features.rubbing.presliding);
        let mut axis = Self {
            plant,
            features,
            is_plain: *train == Default::default()
                && *motor == Default::default()
                && *strange == Default::default(),
            rubs_differently: features.rubbing != Default::default(),
            travel_per_rad: plant.travel_per_rad(),
            torque_per_force: plant.torque_per_force(),
            motor_mobility: plant.travel_per_rad() / ((1.0 - plant.screw_share) * plant.inertia),
            screw_mobility: if has_screw {
                plant.travel_per_rad() / (plant.screw_share * plant.inertia)
            } else {
                0.0
            },
            driver: if has_screw { SCREW } else { MOTOR },
            table_mobility: plant.mass.recip(),
            current_rate: std::f64::consts::TAU * plant.current_loop_hz,
            state: [0.0; 10],
            contact: if elements.are_there() { Contact::Elastic } else { Contact::Stick },
            elements,
            wiper_at: 0.0,
            chain: 0.0,
        };
        (axis.state[MOTOR], axis.state[SCREW]) = (place, place);
        axis.state[TABLE] = axis.nut(place, t);
        axis.wiper_at = axis.state[TABLE];
        axis
    }

    /// Where it is.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Start from somewhere else, in a slip if it moves.
    pub fn set_state(&mut self, state: State) {
        self.state = state;
        if self.contact != Contact::Elastic {
            let speed = state[TABLE_SPEED];
            self.contact = if speed == 0.0 { Contact::Stick } else { Contact::Slip(speed.signum()) };
        }
    }

    /// Whether the table stands in its friction.
    pub fn is_stuck(&self) -> bool {
        self.contact == Contact::Stick
    }

    /// Force that the screw has on the table, N.
    pub fn screw_force(&self, t: f64) -> f64 {
        self.train_force(&self.state, t).force
    }

    /// From `t` on for `step` seconds.
    pub fn advance(&mut self, t: f64, step: f64, push: &Push) {
        let (mut now, mut left) = (t, step);
        for _ in 0..CHANGES_MAX {
            let end = self.runge_kutta(now, left, push);
            if !self.is_over(&end, now + left, push) {
                return self.settle(end);
            }
            let (mut low, mut high) = (0.0, left);
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                if self.is_over(&self.runge_kutta(now, middle, push), now + middle, push) {
                    high = middle;
                } else {
                    low = middle;
                }
            }
            let at_change = self.runge_kutta(now, high, push);
            self.settle(at_change);
            now += high;
            left -= high;
            self.change(now, push);
            if left <= 0.0 {
                return;
            }
        }
        // Changes without end: the table stands for the rest.
        self.state[TABLE_SPEED] = 0.0;
        self.contact = Contact::Stick;
        let end = self.runge_kutta(now, left, push);
        self.settle(end);
    }

    /// Whether the contact cannot have lasted until here.
    fn is_over(&self, state: &State, t: f64, push: &Push) -> bool {
        match self.contact {
            Contact::Elastic => false,
            Contact::Slip(direction) => direction * state[TABLE_SPEED] < 0.0,
            Contact::Stick => {
                let force = self.force_at_rest(state, t, push);
                force.abs() > self.break_away(state, t, force.signum())
            }
        }
    }

    /// The other contact: a table that has come to rest holds or goes the way it is pushed.
    fn change(&mut self, t: f64, push: &Push) {
        self.state[TABLE_SPEED] = 0.0;
        let force = self.force_at_rest(&self.state, t, push);
        let holds = force.abs() <= self.break_away(&self.state, t, force.signum());
        let was_stuck = self.contact == Contact::Stick;
        self.contact = if holds && !was_stuck { Contact::Stick } else { Contact::Slip(force.signum()) };
    }

    /// Takes the state, and what follows it by distance.
    fn settle(&mut self, state: State) {
        let travelled = state[TABLE] - self.state[TABLE];
        if self.contact == Contact::Elastic {
            self.elements.follow(travelled);
        }
        self.state = state;
        let strange = &self.features.strange;
        let [stiffness, limit] = strange.wiper;
        if limit != 0.0 && (stiffness * (state[TABLE] - self.wiper_at)).abs() > limit {
            self.wiper_at = state[TABLE];
        }
        let [_, reach] = strange.chain;
        if reach != 0.0 {
            self.chain += travelled / reach * (1.0 - travelled.signum() * self.chain);
        }
    }

    fn runge_kutta(&self, t: f64, step: f64, push: &Push) -> State {
        let half = 0.5 * step;
        let at = |slope: &State, step: f64| -> State {
            let mut state = self.state;
            for (place, rate) in state.iter_mut().zip(slope) {
                *place += step * rate;
            }
            state
        };
        let k1 = self.slope(&self.state, t, push);
        let k2 = self.slope(&at(&k1, half), t + half, push);
        let k3 = self.slope(&at(&k2, half), t + half, push);
        let k4 = self.slope(&at(&k3, step), t + step, push);
        let mut end = self.state;
        for n in 0..end.len() {
            end[n] += step / 6.0 * (k1[n] + 2.0 * (k2[n] + k3[n]) + k4[n]);
        }
        end
    }

    /// The equations of motion.
    fn slope(&self, state: &State, t: f64, push: &Push) -> State {
        let motor = &self.features.motor;
        let mut slope = [0.0; 10];
        let mut wanted = push.current;
        if motor.lag != 0.0 {
            slope[LAGGING] = (push.current - state[LAGGING]) / motor.lag;
            wanted = state[LAGGING];
        }
        slope[CURRENT] = self.current_rate * (wanted - state[CURRENT]);

        let train = self.train_force(state, t);
        let driving = self.motor_torque(state, t) + push.torque;
        slope[MOTOR] = state[MOTOR_SPEED];
        if self.driver == MOTOR {
            slope[MOTOR_SPEED] = (driving - self.torque_per_force * train.reaction) * self.motor_mobility;
        } else {
            let wound = self.plant.stiffness * (state[MOTOR] - state[SCREW])
                + self.plant.damping * (state[MOTOR_SPEED] - state[SCREW_SPEED]);
            slope[MOTOR_SPEED] = (driving - self.torque_per_force * wound) * self.motor_mobility;
            slope[SCREW] = state[SCREW_SPEED];
            slope[SCREW_SPEED] = self.torque_per_force * (wound - train.reaction) * self.screw_mobility;
        }

        slope[SWING] = state[SWING_SPEED];
        if self.contact != Contact::Stick {
            let force = train.force + push.force + self.table_force(state, t);
            slope[TABLE] = state[TABLE_SPEED];
            slope[TABLE_SPEED] = (force - self.friction(state, t, train.force)) * self.table_mobility;
        }
        if self.features.train.swing_mass != 0.0 {
            slope[SWING_SPEED] =
                -self.swing_force(state) / self.features.train.swing_mass - slope[TABLE_SPEED];
        }
        slope
    }
}
