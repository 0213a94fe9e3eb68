//! Every effect as plain numbers beside the parameters of an axis: what the equations of motion, the controller and
//! the sensors read. All zero is the axis as its machine file has it.
//! Invariant: a feature that is zero changes no bit of a run.

/// A sine over a place or an angle: `amplitude sin(wave q + phase)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wave {
    /// In the unit of what it is added to.
    pub amplitude: f64,
    /// rad per unit of `q`.
    pub wave: f64,
    /// rad.
    pub phase: f64,
}

impl Wave {
    /// Its value, exactly zero without an amplitude.
    #[inline]
    pub fn at(&self, q: f64) -> f64 {
        if self.amplitude == 0.0 { 0.0 } else { self.amplitude * (self.wave * q + self.phase).sin() }
    }

    /// Its value against that at zero, where encoders are set to zero.
    #[inline]
    pub fn from_home(&self, q: f64) -> f64 {
        if self.amplitude == 0.0 { 0.0 } else { self.at(q) - self.at(0.0) }
    }

    /// Its slope.
    #[inline]
    pub fn slope(&self, q: f64) -> f64 {
        if self.amplitude == 0.0 {
            0.0
        } else {
            self.amplitude * self.wave * (self.wave * q + self.phase).cos()
        }
    }
}

/// Something that comes with a time constant: `amplitude (1 - exp(-t / time))`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Growth {
    /// In the end.
    pub amplitude: f64,
    /// s.
    pub time: f64,
}

impl Growth {
    /// Its value, exactly zero without an amplitude.
    pub fn at(&self, t: f64) -> f64 {
        if self.amplitude == 0.0 { 0.0 } else { self.amplitude * (1.0 - (-t / self.time).exp()) }
    }
}

/// Friction at the table that the file does not know.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rubbing {
    /// N s/m.
    pub viscous: f64,
    /// N s^2/m^2.
    pub quadratic: f64,
    /// Friction at rest that is gone at speed: N.
    pub stribeck: f64,
    /// The speed at which it goes, m/s, and how: 2 as a bell, 1 as an exponential, 0 as `1 / (1 + (v/v_s)^2)`.
    pub stribeck_speed: f64,
    /// See `stribeck_speed`.
    pub stribeck_shape: u8,
    /// Mean travel after which an element slips, m; zero: the axis sticks rigidly.
    pub presliding: f64,
    /// Share that is added forward and taken away backward.
    pub asymmetry: f64,
    /// Share of the dry friction over the place of the table: slope per m.
    pub place_slope: f64,
    /// The same as a wave.
    pub place_wave: Wave,
    /// The same as a bump: its height, its place and its width in m.
    pub place_bump: [f64; 3],
    /// Share of the screw's force.
    pub load: f64,
    /// Share that is gone when warm.
    pub warm: Growth,
    /// Share of the dry friction over the turn of the screw.
    pub ripple: [Wave; 2],
}

/// What pulls or stores between motor and table.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Train {
    /// Force against positive travel, N.
    pub constant: f64,
    /// N/m towards `spring_centre`.
    pub spring: f64,
    /// m.
    pub spring_centre: f64,
    /// Play, m.
    pub backlash: f64,
    /// Share of the stiffness that is missing in the soft zone, and its half width, m.
    pub soft_share: f64,
    /// See `soft_share`.
    pub soft_half_width: f64,
    /// Compliance over the place of the table, per m.
    pub compliance_slope: f64,
    /// A mass that swings on the table: kg, Hz, share of critical damping.
    pub swing_mass: f64,
    /// See `swing_mass`.
    pub swing_hz: f64,
    /// See `swing_mass`.
    pub swing_damping: f64,
    /// Travel of the nut beyond that of the motor over the motor's travel, m.
    pub pitch: Wave,
    /// The same in proportion.
    pub scale: f64,
    /// The same, growing with time.
    pub growth: Growth,
    /// Share of what the other axis crosses with that pushes this table.
    pub pushed: f64,
}

/// What the motor does with its current.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motor {
    /// Torque without a current over the motor's angle, N m.
    pub cogging: [Wave; 2],
    /// Share of the torque over the motor's angle.
    pub ripple: Wave,
    /// Loss of torque per current, 1/A.
    pub saturation: f64,
    /// Torque over time, N m.
    pub disturbance: Wave,
    /// From command to current, s.
    pub delay: f64,
    /// First order ahead of the current loop, s.
    pub lag: f64,
}

/// What is measured beside what is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// Of the motor encoder over the motor's travel, m: the once-per-turn error and that within a line.
    pub motor: [Wave; 2],
    /// Of the table scale over the place of the table, m.
    pub table: Wave,
    /// Table reading by the other axis' place, rad.
    pub squareness: f64,
    /// Table reading by what the other axis crosses with, m/N.
    pub tilt: f64,
    /// Share by which the measured current is off.
    pub current_gain: f64,
}

impl Reading {
    /// Error of the motor encoder at a place.
    #[inline]
    pub fn motor_error(&self, place: f64) -> f64 {
        self.motor[0].from_home(place) + self.motor[1].from_home(place)
    }
}

/// What the controller does that its settings do not say.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Loops {
    /// Share by which the position gain is off.
    pub position_gain: f64,
    /// Share by which both gains of the velocity loop are off.
    pub velocity_gain: f64,
    /// Filter of the setpoint: first order, s.
    pub filter_time: f64,
    /// Filter of the setpoint: mean over so long, s.
    pub mean_time: f64,
    /// Current at the setpoint's reversal, A, and how long it lasts, s.
    pub pulse: f64,
    /// See `pulse`.
    pub pulse_time: f64,
    /// The pulse is a rectangle instead of a decay.
    pub pulse_is_flat: bool,
}

/// What no catalogue has.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Strange {
    /// The scale's head is loose: play of the table reading, m.
    pub loose_head: f64,
    /// A cover that is dragged, holds and snaps: its stiffness N/m, and the force at which it lets go, N.
    pub wiper: [f64; 2],
    /// A rough spot of a bearing: torque N m, angle between two hits rad, width rad.
    pub hits: [f64; 3],
    /// A tool in the cut: force N, while the table is in the upper part of its travel and moves, at so many Hz.
    pub cut: [f64; 2],
    /// A chain that must be bent: force N, travel over which it follows, m.
    pub chain: [f64; 2],
    /// Somebody turns the override knob: share of the speed, from, to (s).
    pub override_dip: [f64; 3],
    /// A belt between motor and screw whose teeth mesh: saw-tooth of torque N m, teeth per turn.
    pub teeth: [f64; 2],
    /// Magnets that want to hold: force N, distance between them m, reach m.
    pub magnets: [f64; 3],
}

/// All of it, for one axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Features {
    /// Friction.
    pub rubbing: Rubbing,
    /// Drive train.
    pub train: Train,
    /// Motor.
    pub motor: Motor,
    /// Sensors.
    pub reading: Reading,
    /// Controller.
    pub loops: Loops,
    /// What no catalogue has.
    pub strange: Strange,
    /// The other axis crosses with what accelerates its table, and not with the force of its screw.
    pub is_crossed_by_inertia: bool,
}
