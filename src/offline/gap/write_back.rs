//! What was named, into the machine file: each effect with its interval, the runs it comes from, date and commit; and
//! the base parameters that it was fitted with, without which it does not hold.
//!
//! Invariant: comments and all other keys stay, and what is no sound machine is not written.

use super::analysis::Analysis;
use super::model::Model;
use super::model::twin::{BRISTLES, bristles_of};
use super::model::usual::is_usual;
use crate::config::Machine;
use crate::config::edit::{EditError, MachineFile};

/// What notes are known by.
const MARK: &str = "gap";
/// Digits that are written of a value.
const DIGITS: i32 = 5;

/// Where values come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Names of the runs.
    pub runs: String,
    /// When they were analysed.
    pub date: String,
    /// Of the program.
    pub commit: String,
}

/// Puts what was named of all axes into a file; whether there was anything.
///
/// # Errors
/// When a key cannot be set.
pub fn put(
    file: &mut MachineFile,
    machine: &Machine,
    analysis: &Analysis<'_>,
    origin: &Origin,
) -> Result<bool, EditError> {
    let mut is_changed = false;
    for axis in analysis.axes.iter().filter(|axis| !axis.named.effects.is_empty()) {
        let name = &machine.axis_names()[axis.id.index()];
        let model = &axis.named.model;
        for (place, tried) in model.model.effects.iter().enumerate() {
            let is_named = place < axis.named.effects.len();
            // What stays with the base is nothing where it may be, and what drifted was of that day.
            let is_sure = |(_, _, [low, high]): &(&str, f64, [f64; 2])| low * high > 0.0;
            let is_of_machine = is_usual(tried.entry) && model.effect(place).first().is_some_and(is_sure);
            if !is_named && !is_of_machine {
                continue;
            }
            let section = format!("axis.{name}.effects.{}", tried.entry.name);
            for (key, value, interval) in model.effect(place) {
                let value = rounded(value);
                file.set(&format!("{section}.{key}"), value)?;
                // Rounded, it still holds the value.
                let [low, high] = interval.map(rounded);
                let ends: toml_edit::Array = [low.min(value), high.max(value)].into_iter().collect();
                file.set(&format!("{section}.{key}-ci95"), ends)?;
            }
            for (key, text) in [("source", &origin.runs), ("date", &origin.date), ("commit", &origin.commit)]
            {
                file.set(&format!("{section}.{key}"), text.as_str())?;
            }
        }
        let was = Model::new(axis.named.base.model.nominal);
        for ((section, key, value), (.., before)) in base(&model.model).into_iter().zip(base(&was)) {
            if (value - before).abs() > 1e-9 * before.abs() {
                file.set(&format!("axis.{name}.{section}.{key}"), rounded(value))?;
            }
        }
        if let Some(seen) = axis.other_estimate() {
            file.set(&format!("axis.{name}.motor-encoder.velocity-estimate"), seen.name())?;
        }
        for section in ["drive", "mechanics", "friction"] {
            let text =
                format!("fitted with its effects to {}, {}, by {}", origin.runs, origin.date, origin.commit);
            file.note(&format!("axis.{name}.{section}"), MARK, &text)?;
        }
        is_changed = true;
    }
    Ok(is_changed)
}

/// Section, key and value of the base parameters, without what the effects add to them.
fn base(model: &Model) -> Vec<(String, &'static str, f64)> {
    let plant = Model { effects: Vec::new(), ..model.clone() }.twin().plant;
    let (mechanics, friction) = (&plant.mechanics, &plant.friction);
    let of_sections = [
        ("drive", "current-loop-hz", plant.actuator.current_loop_hz),
        ("mechanics", "mass-kg", mechanics.mass_kg),
        ("mechanics", "stiffness-n-per-um", 1e-6 * mechanics.stiffness_n_per_m),
        ("mechanics", "damping-n-s-per-mm", 1e-3 * mechanics.damping_n_s_per_m),
        ("mechanics", "motor-inertia-kg-m2", mechanics.inertia_kg_m2),
        ("mechanics", "carried-inertia-percent", 1e2 * mechanics.carried_share.max(0.0)),
        ("friction", "breakaway-n", friction.breakaway.as_n()),
        ("friction", "sliding-n", friction.sliding.as_n()),
        ("friction", "fall-end-mm-per-s", friction.fall_end.as_mm_per_s()),
        ("friction", "fall-start-mm-per-s", friction.fall_start.as_mm_per_s()),
        ("friction", "viscous-n-s-per-mm", 1e-3 * friction.viscous_n_s_per_m),
    ];
    // Those of an effect that was named are written with it.
    let is_named = model.effects.iter().any(|tried| tried.entry.effect() == BRISTLES);
    let bristles = bristles_of(&plant).filter(|_| !is_named);
    let of_bristles = bristles.map(|(law, values)| (format!("effects.{}", law.name), "way-um", values[0]));
    let of_sections = of_sections.into_iter().map(|(section, key, value)| (section.to_owned(), key, value));
    of_sections.chain(of_bristles).collect()
}

/// To so many digits as a value is worth.
fn rounded(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return 0.0;
    }
    let scale = 10_f64.powi(DIGITS - 1 - value.abs().log10().floor() as i32);
    (value * scale).round() / scale
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::offline::gap::model::Tried;
    use crate::plant::effects::entry;
    use crate::plant::tests::paper_axis;

    #[test]
    fn bristles_of_a_file_are_written_as_the_base_has_them_or_as_they_were_named() {
        let presliding = entry("presliding").expect("an effect");
        let mut model = Model::new(paper_axis().with_effect(presliding, [8.0, 0.0, 0.0]));
        *model.base.last_mut().expect("the way of bristles") = 1.0;
        let (section, key, way_um) = base(&model).pop().expect("parameters");
        assert_eq!((section.as_str(), key), ("effects.presliding", "way-um"));
        assert!((way_um - 8.0 * 0.25_f64.exp()).abs() < 1e-9, "{way_um} um");
        let named = model.with(Tried { entry: presliding, values: [30.0, 0.0, 0.0] });
        assert!(base(&named).iter().all(|(section, ..)| !section.starts_with("effects")));
    }
}
