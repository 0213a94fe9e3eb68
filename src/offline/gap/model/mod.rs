//! What is fitted: the parameters of the base model, which are never "effects", and beside them effects of the
//! catalogue.
//!
//! A base parameter is fitted as the logarithm of its ratio to what the machine file says, in steps of its prior; an
//! effect's value in steps of its own. So every coordinate is 0 where nothing is known, and 1 is as far as a
//! machine usually is from its file.
//!
//! ```text
//!   twin: base parameters ─┬► model ─┬► problem: what it leaves of the runs, as noise of variance 1 ──► linear: derivatives
//!   effects, usual, little ┘         └► steps: how wide derivatives are ──► secant: what they learn underway
//! ```
//!
//! A row counts where the model is `straight` about it, or at first where the axis is `moving`; `shaken` is what noise does to
//! means, `sensors` are parameters that move nothing, `zeros` are those of table scales, `levels` how loud a signal is.
//! Invariant: coordinates make a plant that `config` would accept.

pub mod data;
mod levels;
pub mod linear;
pub(super) mod little;
pub(super) mod moving;
pub mod problem;
mod secant;
pub(super) mod sensors;
mod shaken;
pub mod steps;
mod straight;
mod tried;
pub mod twin;
pub(super) mod usual;
pub mod zeros;

use crate::offline::gap::measure::forward::DEFLECTION;
use crate::plant::Parameters;
use crate::plant::effects::{Parameter, VALUES_MAX, Values, entry};

pub use tried::Tried;
use twin::{BASE, BRISTLES, Base, Twin};
use usual::is_usual;

/// Values so near to a bound are at it, as a share of what is between both.
const AT_BOUND: f64 = 1e-4;
/// How friction falls, as [`BASE`] names it.
pub(super) const FALL: [&str; 3] = ["breakaway_excess", "fall_end", "fall_start"];
/// The effect that is a fall of friction too.
pub(super) const FALLS: &str = "stribeck";
/// What the base makes of an effect as far as it reaches: its parameter, N s/m, and the effect, N s/mm.
const MADE_OF: (&str, &str) = ("viscous", "viscous-friction");
/// Another parameter of the base, and the effect that stands in its place.
const IN_ITS_PLACE: (&str, &str) = ("presliding_way", BRISTLES);
/// More priors than this a base goes only to make up for something.
const GONE_FAR: f64 = 3.0;
/// How far an amplitude is from zero that the base makes up for, in coordinates. Left free, a gain of the velocity loop would take from
/// masses and forces what a torque constant that is off has made of them all.
const OF_BASE: f64 = 0.05;
/// A swing is one of once a turn where its period is so near to the lead, as a share.
const ONCE_A_TURN: f64 = 3e-3;
/// A plant that is fitted: a file's, base coordinates, effects.
#[derive(Clone, Debug)]
pub struct Model {
    /// What the machine file says.
    pub nominal: Parameters,
    /// Base coordinates, in priors.
    pub base: [f64; BASE.len()],
    /// The effects that were added to the file's.
    pub effects: Vec<Tried>,
}

impl Model {
    /// Of a machine file.
    pub const fn new(nominal: Parameters) -> Self {
        Self { nominal, base: [0.0; BASE.len()], effects: Vec::new() }
    }

    /// The same with another effect. What the base had made of it is of the effect then: their sum is known, and a file is not wrong by
    /// as much as an effect may be.
    #[must_use]
    pub fn with(&self, mut tried: Tried) -> Self {
        let mut model = self.clone();
        let made_of =
            BASE.iter().zip(&mut model.base).find(|(base, _)| MADE_OF == (base.name, tried.entry.name));
        if let Some((base, at)) = made_of.filter(|(_, at)| **at > 0.0) {
            let [made, filed] = [self, &Self::new(self.nominal)].map(|model| base.of(&model.twin()));
            tried.values[0] += 1e-3 * (made - filed);
            *at = 0.0;
        }
        model.effects.push(tried);
        model
    }

    /// Name of the effect that was added last, whichever law of it.
    pub(super) fn last_effect(&self) -> Option<&'static str> {
        self.effects.last().map(|tried| tried.entry.effect())
    }

    /// The same without the effect of a place in the list.
    #[must_use]
    pub fn without(&self, place: usize) -> Self {
        let mut model = self.clone();
        model.effects.remove(place);
        model
    }

    /// The same where friction falls as the file says.
    #[must_use]
    pub(super) fn falling_as_filed(&self) -> Self {
        let mut model = self.clone();
        for (base, at) in BASE.iter().zip(&mut model.base) {
            if FALL.contains(&base.name) {
                *at = 0.0;
            }
        }
        model
    }

    /// The same with its last effect by each other law that it may follow with as many numbers.
    pub(super) fn by_other_laws(&self) -> impl Iterator<Item = Self> {
        let is_law =
            |other: &Self| other.last_effect() == self.last_effect() && other.numbers() == self.numbers();
        self.with_last_as_alike().filter(is_law)
    }

    /// The same without the effects of some places in the list.
    #[must_use]
    pub fn without_all(&self, places: &[usize]) -> Self {
        let mut model = self.clone();
        let mut place = 0..;
        model.effects.retain(|_| place.next().is_none_or(|place| !places.contains(&place)));
        model
    }

    /// The same with each effect that is like its last one in that one's place, as large as it may be.
    pub fn with_last_as_alike(&self) -> impl Iterator<Item = Self> {
        self.effects
            .last()
            .into_iter()
            .flat_map(Tried::alike)
            .map(|tried| self.without(self.effects.len() - 1).with(tried))
    }

    /// The same where another effect has given half of itself to the last one, which changes much the same: what is named first does what both
    /// do, and a line from there does not lead to where each does its own.
    pub(super) fn with_last_sharing(&self) -> Vec<Self> {
        let Some((last, others)) = self.effects.split_last() else { return Vec::new() };
        let sharing = |(place, other): (usize, &Tried)| {
            let given = other.half().alike().find(|given| given.entry.name == last.entry.name)?;
            let mut model = self.clone();
            model.effects[place] = other.half();
            *model.effects.last_mut()? = given;
            Some(model)
        };
        let is_another = |(_, other): &(usize, &Tried)| other.entry.effect() != last.entry.effect();
        others.iter().enumerate().filter(is_another).filter_map(sharing).collect()
    }

    /// The same with what a table scale cannot tell from its last effect in that one's place: an encoder that swings once a turn and a
    /// screw that does, the other way round, for loops follow their encoder. Nothing where there is none, or it is there beside it.
    /// A period is that of a turn where it is so near to it, as a share, or nearer than any two of them are told apart.
    pub fn with_last_as_its_twin(&self, within: f64) -> Option<Self> {
        let twin = self.twin_of(self.effects.last()?, within.max(ONCE_A_TURN))?;
        let is_there = self.effects.iter().any(|tried| tried.entry.name == twin.entry.name);
        (!is_there).then(|| self.without(self.effects.len() - 1).with(twin))
    }

    fn twin_of(&self, tried: &Tried, within: f64) -> Option<Tried> {
        let lead_mm = 1e3 * self.nominal.mechanics.lead_m;
        let [size, second, third] = tried.values;
        let (name, values) = match tried.entry.name {
            "encoder-eccentricity" => ("pitch-error", [size, lead_mm, wrapped(second + 180.0)]),
            "pitch-error" if (second / lead_mm - 1.0).abs() < within => {
                ("encoder-eccentricity", [size, wrapped(third + 180.0), 0.0])
            }
            _ => return None,
        };
        Some(Tried { entry: entry(name)?, values })
    }

    /// Whether it has the twin of an effect: the two beside each other are one, in shares that chance makes.
    pub(super) fn has_twin_of(&self, tried: &Tried) -> bool {
        // A pitch error of another period is no twin, and has none.
        let is_twin = |twin: Tried| twin.entry.name == tried.entry.name;
        let twin_of = |tried: &Tried| self.twin_of(tried, ONCE_A_TURN);
        twin_of(tried).is_some() && self.effects.iter().any(|own| twin_of(own).is_some_and(is_twin))
    }

    /// Whether a parameter of the base is so far from what the file says that it makes up for something.
    pub(super) fn has_gone_far(&self) -> bool {
        BASE.iter().zip(&self.base).any(|(base, at)| !base.is_zero() && at.abs() > GONE_FAR)
    }

    /// What it is simulated with.
    pub fn twin(&self) -> Twin {
        let mut twin = Twin::new(self.nominal);
        BASE.iter().zip(&self.base).for_each(|(base, coordinate)| base.move_to(*coordinate, &mut twin));
        for tried in &self.effects {
            twin.plant = twin.plant.with_effect(tried.entry, tried.values);
        }
        twin
    }

    /// The base parameters of the machine as they came out.
    pub fn base_values(&self) -> Vec<(&'static Base, f64)> {
        let twin = self.twin();
        BASE.iter().filter(|base| !base.is_zero()).map(|base| (base, base.of(&twin))).collect()
    }

    /// How many coordinates are fitted.
    pub fn coordinate_count(&self) -> usize {
        BASE.len() + self.effects.iter().map(|tried| tried.entry.parameters.len()).sum::<usize>()
    }

    /// How many of them say something of their own: what the base may stand for says nothing.
    pub fn numbers(&self) -> usize {
        BASE.len() + self.effects.iter().map(|tried| tried.entry.numbers()).sum::<usize>()
    }

    /// The first coordinate of the effect of a place in the list.
    pub fn first_coordinate(&self, place: usize) -> usize {
        let before = self.effects.iter().take(place);
        BASE.len() + before.map(|tried| tried.entry.parameters.len()).sum::<usize>()
    }

    /// Coordinates of effects that are no amplitudes: where one is zero they say nothing.
    pub fn shapes(&self) -> impl Iterator<Item = usize> {
        (0..self.effects.len()).flat_map(|place| {
            let (first, entry) = (self.first_coordinate(place), self.effects[place].entry);
            let shapes = (0..entry.parameters.len()).filter(|of| !entry.is_amplitude(*of));
            shapes.map(move |of| first + of)
        })
    }

    /// The coordinate of the force that is always there.
    pub(super) fn constant_force(&self) -> Option<usize> {
        let place = self.effects.iter().position(|tried| tried.entry.name == "constant-force")?;
        Some(self.first_coordinate(place))
    }

    /// The coordinate of the zero of the table scale, and how much of it one metre is.
    pub(super) fn table_zero() -> (usize, f64) {
        let of_table = |base: &Base| base.zero_of == Some(DEFLECTION);
        let at = BASE.iter().position(of_table).expect("a zero of the table scale");
        (at, BASE[at].prior.recip())
    }

    /// Whether a coordinate moves anything: a share of what the file says is nothing does not.
    pub fn is_free(&self, coordinate: usize) -> bool {
        let Some(base) = BASE.get(coordinate) else { return true };
        // Which of both has made it no row tells, and what roughness of the rows tells of it is nothing.
        let is_of_effect =
            |tried: &Tried| [MADE_OF, IN_ITS_PLACE].contains(&(base.name, tried.entry.effect()));
        base.is_free(&self.nominal) && !self.effects.iter().any(is_of_effect)
    }

    /// Whether it has no effect but what every model has.
    pub(super) fn is_base(&self) -> bool {
        self.effects.iter().all(|tried| is_usual(tried.entry))
    }

    /// Coordinates of the base that are as far from the file as they may be.
    pub fn at_reach(&self) -> impl Iterator<Item = usize> {
        (0..BASE.len()).filter(|place| BASE[*place].is_at_reach(self.base[*place]))
    }

    /// All coordinates.
    pub fn coordinates(&self) -> Vec<f64> {
        let effects = self.effects.iter().flat_map(|tried| {
            let scaled = |(value, parameter): (&f64, &Parameter)| value / parameter.prior;
            tried.values.iter().zip(tried.entry.parameters).map(scaled).collect::<Vec<_>>()
        });
        self.base.iter().copied().chain(effects).collect()
    }

    /// Where a coordinate is believed to be before there are data: an amplitude at zero, the rest where it usually is.
    pub fn expected(&self) -> Vec<f64> {
        let effects = self.effects.iter().flat_map(|tried| {
            let of = |(place, parameter): (usize, &Parameter)| {
                if tried.entry.is_amplitude(place) { 0.0 } else { parameter.nominal / parameter.prior }
            };
            tried.entry.parameters.iter().enumerate().map(of).collect::<Vec<_>>()
        });
        std::iter::repeat_n(0.0, BASE.len()).chain(effects).collect()
    }

    /// How sure that is, as a standard deviation in coordinates. An amplitude is held by nothing but its bounds: data
    /// alone say how large an effect is; but for one that the base makes up for, of which they say nothing.
    pub fn sureness(&self) -> Vec<f64> {
        let effects = self.effects.iter().flat_map(|tried| {
            let of = |(place, parameter): (usize, &Parameter)| match parameter.is_of_base {
                true => OF_BASE,
                false if tried.entry.is_amplitude(place) => f64::INFINITY,
                false => 2.0,
            };
            tried.entry.parameters.iter().enumerate().map(of)
        });
        std::iter::repeat_n(1.0, BASE.len()).chain(effects).collect()
    }

    /// Widest step of each coordinate over which a derivative means something: this one, or where something swings as small a
    /// one as leaves it in step.
    pub fn widest_steps(&self, widest: f64) -> Vec<f64> {
        let effects = self.effects.iter().flat_map(|tried| {
            let of = |(value, parameter): (&f64, &Parameter)| {
                widest.min(parameter.small_step(*value) / parameter.prior)
            };
            tried.values.iter().zip(tried.entry.parameters).map(of).collect::<Vec<_>>()
        });
        std::iter::repeat_n(widest, BASE.len()).chain(effects).collect()
    }

    /// The same at other coordinates, held within the bounds.
    #[must_use]
    pub fn at(&self, coordinates: &[f64]) -> Self {
        let mut model = self.clone();
        let (base, mut rest) = coordinates.split_at(BASE.len());
        for ((own, new), base) in model.base.iter_mut().zip(base).zip(&BASE) {
            *own = base.within_reach(*new);
        }
        for tried in &mut model.effects {
            let parameters = tried.entry.parameters;
            let (own, others) = rest.split_at(parameters.len());
            let mut values: Values = [0.0; VALUES_MAX];
            for ((value, parameter), coordinate) in values.iter_mut().zip(parameters).zip(own) {
                let [low, high] = parameter.bounds;
                let wanted = coordinate * parameter.prior;
                *value = if parameter.unit == "deg" { wrapped(wanted) } else { wanted.clamp(low, high) };
            }
            tried.values = values;
            rest = others;
        }
        model
    }

    /// Effects that are at a bound other than zero: what is there is not what the data say.
    pub fn is_at_bound(&self, place: usize) -> bool {
        let tried = &self.effects[place];
        tried.values.iter().zip(tried.entry.parameters).any(|(value, parameter)| {
            let [low, high] = parameter.bounds;
            // A guide that gives way by less sticks.
            let is_open_below = parameter.key == "way-um";
            // A fit may end just before it.
            let near = AT_BOUND * (high - low);
            let is_low = *value <= low + near && low != 0.0 && !is_open_below;
            !parameter.is_open() && (is_low || *value >= high - near)
        })
    }
}

fn wrapped(deg: f64) -> f64 {
    (deg + 180.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
mod tests {
    use super::tried::LIGHT;
    use super::*;
    use crate::plant::tests::paper_axis;

    #[test]
    fn what_the_base_had_made_of_a_viscous_friction_is_of_the_effect() {
        let mut file = paper_axis();
        file.friction.viscous_n_s_per_m = 400.0;
        let viscous = |n_s_per_mm: f64| Tried {
            entry: entry("viscous-friction").expect("an effect"),
            values: [n_s_per_mm, 0.0, 0.0],
        };
        let at = BASE.iter().position(|base| base.name == "viscous").expect("a parameter");
        for (coordinate, of_base, of_effect) in [(3.25, 400.0, 0.1 + 0.5014), (-1.0, 311.52, 0.1)] {
            let mut model = Model::new(file);
            model.base[at] = coordinate;
            let with = model.with(viscous(0.1));
            let [base, effect] = [BASE[at].of(&with.without(0).twin()), with.effects[0].values[0]];
            assert!(model.is_free(at) && !with.is_free(at), "one of both is asked for");
            assert!((base - of_base).abs() < 0.01 && (effect - of_effect).abs() < 1e-4, "{base}, {effect}");
        }
    }

    #[test]
    fn a_swing_of_once_a_turn_is_that_of_the_encoder_or_of_the_screw() {
        let of = |name: &str, values| {
            let tried = Tried { entry: entry(name).expect("an effect"), values };
            let twin = Model::new(paper_axis()).with(tried).with_last_as_its_twin(0.0)?;
            Some((twin.effects[0].entry.name, twin.effects[0].values))
        };
        let screw = ("pitch-error", [2.0, 10.0, -140.0]);
        assert_eq!(of("encoder-eccentricity", [2.0, 40.0, 0.0]), Some(screw));
        assert_eq!(of("pitch-error", screw.1), Some(("encoder-eccentricity", [2.0, 40.0, 0.0])));
        assert_eq!(of("pitch-error", [2.0, 10.2, 0.0]), None, "a period of its own");
        let near = Tried { entry: entry("pitch-error").expect("an effect"), values: [2.0, 10.2, 0.0] };
        let near = Model::new(paper_axis()).with(near);
        assert!(near.with_last_as_its_twin(0.01).is_none());
        assert!(near.with_last_as_its_twin(0.03).is_some(), "a period that is no surer than that");
        assert_eq!(of("backlash", [2.0, 0.0, 0.0]), None);
        let beside = |values, name: &str, other: [f64; 3]| {
            let [own, other] = [("pitch-error", values), (name, other)]
                .map(|(name, values)| Tried { entry: entry(name).expect("an effect"), values });
            Model::new(paper_axis()).with(own).has_twin_of(&other)
        };
        assert!(beside(screw.1, "encoder-eccentricity", [1.0, 0.0, 0.0]));
        assert!(!beside([2.0, 37.0, 0.0], "encoder-eccentricity", [1.0, 0.0, 0.0]), "a period of its own");
        assert!(!beside(screw.1, "backlash", [1.0, 0.0, 0.0]));
        let both = ["pitch-error", "encoder-eccentricity"].map(|name| entry(name).expect("an effect"));
        let beside = both.iter().fold(Model::new(paper_axis()), |model, entry| {
            model.with(Tried { entry, values: [1.0, 60.0, 0.0] })
        });
        assert!(beside.with_last_as_its_twin(0.0).is_none(), "it has that one already");
    }

    #[test]
    fn what_is_alike_takes_the_place_of_the_other_and_its_size() {
        let tried = |name: &str| Tried { entry: entry(name).expect("an effect"), values: [700.0, 0.0, 0.0] };
        let zone = Tried { entry: entry("soft-zone").expect("an effect"), values: [90.0, 2.0, 0.0] };
        let play = Model::new(paper_axis()).with(zone).with_last_as_alike().next().expect("a backlash");
        assert_eq!(play.effects[0].entry.name, "backlash");
        assert!((play.effects[0].values[0] - 3.6).abs() < 1e-9, "{:?}", play.effects[0].values);
        let model = Model::new(paper_axis()).with(tried("backlash")).with(tried("current-loop-lag"));
        let other = model.with_last_as_alike().next().expect("a delay");
        let names: Vec<&str> = other.effects.iter().map(|tried| tried.entry.name).collect();
        assert_eq!(names, ["backlash", "actuator-delay"]);
        assert_eq!(other.effects[1].values[0], 700.0);
        let lags: Vec<&str> = other.with_last_as_alike().map(|lag| lag.effects[1].entry.name).collect();
        assert_eq!(lags, ["current-loop-lag", "current-loop-lag-filter"]);
        let again: Vec<Model> = play
            .with_last_as_alike()
            .flat_map(|zone| zone.with_last_as_alike().collect::<Vec<_>>())
            .collect();
        assert!((again[0].effects[0].values[0] - 3.6).abs() < 1e-9, "{:?}", again[0].effects[0].values);
        let alone = Model::new(paper_axis());
        let grown = alone.with(tried("thermal-growth")).with_last_as_alike().next().expect("a scale");
        assert_eq!((grown.effects[0].entry.name, grown.effects[0].values[0]), ("scale-error", 700.0));
        assert_eq!(alone.with(tried("stribeck")).with_last_as_alike().count(), 0);
    }

    #[test]
    fn what_is_alike_takes_a_half_of_what_is_there_already() {
        let with = |model: Model, name: &str, values: Values| {
            model.with(Tried { entry: entry(name).expect("an effect"), values })
        };
        let file = Model::new(paper_axis());
        let ripple = with(file.clone(), "screw-ripple", [2.0, 1.0, 30.0]);
        let play = with(ripple.clone(), "backlash", [6.0, 0.0, 0.0]);
        let values = |model: &Model| -> Vec<Values> { model.effects.iter().map(|one| one.values).collect() };
        let sharing = with(play.clone(), "soft-zone", [35.0, 0.8, 0.0]).with_last_sharing();
        assert_eq!(sharing.len(), 1);
        // Three micrometres of play, and as much in a zone of two and a half to either side, as soft as usual.
        assert_eq!(values(&sharing[0]), [[2.0, 1.0, 30.0], [3.0, 0.0, 0.0], [60.0, 2.5, 0.0]]);
        for other in [
            with(play, "motor-cogging", [0.1, 12.0, 0.0]),
            with(ripple, "soft-zone", [35.0, 0.8, 0.0]),
            // Two laws of one effect.
            with(with(file, "presliding", [0.1, 0.0, 0.0]), "presliding-with-memory", [0.4, 1.5, 0.0]),
        ] {
            assert!(other.with_last_sharing().is_empty(), "{:?}", values(&other));
        }
    }

    #[test]
    fn what_swings_is_begun_once_more_where_it_is_damped_by_more_than_machines_are() {
        let swinging = |damping: f64| {
            let tried = Tried { entry: entry("resonance").expect("an effect"), values: [7.0, 42.0, damping] };
            let model = Model::new(paper_axis()).with(tried);
            model.with_last_as_alike().map(|other| other.effects[0].values).collect::<Vec<Values>>()
        };
        assert_eq!(swinging(15.0), [[7.0, 42.0, LIGHT]]);
        assert!(swinging(2.5).is_empty(), "it is where it would begin");
    }
}
