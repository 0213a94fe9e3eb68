//! The shipped control on the shipped plant with nothing between them: no frames, no encoder, no dead
//! time. What is left is the loop and the plant's integrator, whose step is what is judged.

use std::f64::consts::FRAC_PI_4;

use quadrant::base::axis::AxisId;
use quadrant::base::motion::{Circle, Direction};
use quadrant::base::sample::{Freshness, Sample};
use quadrant::base::time::{Moment, Span};
use quadrant::base::units::{Acceleration, Position, Velocity};
use quadrant::config::Machine;
use quadrant::plant::{self, Plant};
use quadrant::rt::control::profile::{CircleMotion, Profile};
use quadrant::rt::control::{AxisLoop, Settings};

const TICK: Span = Span::us(500);

/// Control and plant of both axes.
#[derive(Clone, Copy)]
pub(crate) struct Axis {
    pub(crate) control: Settings,
    pub(crate) plant: plant::Parameters,
}

impl Axis {
    /// The X axis of a machine with one of its gain sets in place of the first.
    pub(crate) fn of(machine: &Machine, gains: &str) -> Self {
        let axis = &machine.axes[AxisId::X];
        let set = machine.gain_set(gains).expect("the machine has these gains");
        let mut control = axis.control;
        control.gain_sets[0] = *machine.gains(AxisId::X, set);
        Self { control, plant: axis.plant }
    }
}

/// Height of the highest protrusion of a circle over the response without friction, um.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Protrusion {
    pub(crate) motor_um: f64,
    pub(crate) table_um: f64,
}

/// A path with friction beside the one without: the paper's circle, 150 mm at 2000 mm/min.
pub(crate) struct Comparison {
    axis: Axis,
    smooth: Vec<Radii>,
}

/// Distances from the centre at one tick of the measured part, m.
#[derive(Clone, Copy)]
struct Radii {
    motor_m: f64,
    table_m: f64,
}

impl Comparison {
    /// Runs the response without friction.
    pub(crate) fn new(axis: Axis) -> Self {
        let frictionless = Axis { plant: axis.plant.without_friction(), ..axis };
        Self { axis, smooth: radii(&frictionless, plant::FINE_STEPS) }
    }

    /// Runs the circle with friction, in so many fine steps a tick.
    pub(crate) fn protrusion(&self, fine_steps: u32) -> Protrusion {
        let rough = radii(&self.axis, fine_steps);
        assert_eq!(rough.len(), self.smooth.len(), "both paths have the same measured ticks");
        let highest_um = |radius_m: fn(&Radii) -> f64| {
            let over = rough.iter().zip(&self.smooth).map(|(a, b)| radius_m(a) - radius_m(b));
            over.fold(f64::NEG_INFINITY, f64::max) * 1e6
        };
        Protrusion { motor_um: highest_um(|r| r.motor_m), table_um: highest_um(|r| r.table_m) }
    }
}

fn motion() -> CircleMotion {
    CircleMotion {
        circle: Circle {
            centre_x: Position::ZERO,
            centre_y: Position::ZERO,
            radius: Position::mm(150.0),
            feed: Velocity::mm_per_min(2000.0),
            direction: Direction::Ccw,
            start_angle_rad: FRAC_PI_4,
            revolutions: 1,
        },
        run_in_s: 1.5,
        run_out_s: 0.0,
        acceleration: Acceleration::m_per_s2(0.5),
    }
}

/// One axis: what it stands on when the circle begins, its loops, its plant.
struct Loop {
    start: Position,
    control: AxisLoop,
    plant: Plant,
}

impl Loop {
    fn new(axis: &Axis, start: Position, fine_steps: u32) -> Self {
        let mut control = AxisLoop::new(&axis.control);
        control.follow(&Sample { position: start, ..Sample::default() });
        Self { start, control, plant: Plant::with_fine_steps(&axis.plant, TICK, fine_steps) }
    }

    /// Motor and table before the tick, m.
    fn tick(&mut self, setpoint: &quadrant::base::setpoint::Setpoint, is_position_tick: bool) -> [f64; 2] {
        let state = self.plant.state();
        let [motor, table] = [state.motor_position, state.table_position].map(|place| self.start + place);
        let sample = Sample {
            freshness: Freshness::Fresh,
            position: motor,
            velocity: state.motor_velocity,
            table_position: table,
            ..Sample::default()
        };
        let answer = self.control.step(setpoint, &sample, is_position_tick);
        self.plant.step(answer.current);
        [motor.as_m(), table.as_m()]
    }
}

fn radii(axis: &Axis, fine_steps: u32) -> Vec<Radii> {
    let motion = motion();
    let starts = <[Position; 2]>::from(motion.start());
    let mut loops = starts.map(|start| Loop::new(axis, start, fine_steps));
    let mut profile = Profile::new(2);
    for (id, start) in [AxisId::X, AxisId::Y].into_iter().zip(starts) {
        profile.stand(id, start);
    }
    assert!(profile.start_circle(&motion, Moment::ZERO), "the axes stand at the start");
    let mut radii = Vec::new();
    for tick in 0.. {
        let now = Moment::ZERO + TICK * tick;
        profile.advance(now);
        if !profile.is_running() {
            break;
        }
        let is_position_tick = tick % i64::from(axis.control.position_every) == 0;
        let mut ids = [AxisId::X, AxisId::Y].into_iter();
        let [x, y] = loops.each_mut().map(|axis_loop| {
            let id = ids.next().expect("one for each loop");
            axis_loop.tick(&profile.setpoints()[id], is_position_tick)
        });
        if profile.is_measured(now) {
            radii.push(Radii { motor_m: x[0].hypot(y[0]), table_m: x[1].hypot(y[1]) });
        }
    }
    radii
}
