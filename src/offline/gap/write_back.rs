//! What was named, into the machine file: each effect with its interval, the runs it comes from, date and commit; and
//! the base parameters that it was fitted with, without which it does not hold.
//!
//! Invariant: comments and all other keys stay, and what is no sound machine is not written.

use super::analysis::Analysis;
use super::model::Model;
use super::twin::bristles_of;
use super::usual::is_usual;
use crate::config::Machine;
use crate::config::edit::{EditError, MachineFile};
use crate::plant::Parameters;

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
        let filed = [&model.model, &was].map(way_um);
        if let [Some((law, way_um)), Some((was_law, was_um))] = filed
            && law == was_law
            && (way_um - was_um).abs() > 1e-9 * was_um
        {
            file.set(&format!("axis.{name}.effects.{law}.way-um"), rounded(way_um))?;
        }
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

/// The plant of the base, without what effects add to it.
fn plant_of_base(model: &Model) -> Parameters {
    Model { effects: Vec::new(), ..model.clone() }.twin().plant
}

/// By which law a machine file has bristles, and over which way they give way in the base.
fn way_um(model: &Model) -> Option<(&'static str, f64)> {
    bristles_of(&plant_of_base(model)).map(|(law, values)| (law.name, values[0]))
}

/// Section, key and value of the base parameters, without what the effects add to them.
fn base(model: &Model) -> [(&'static str, &'static str, f64); 11] {
    let plant = plant_of_base(model);
    let (mechanics, friction) = (&plant.mechanics, &plant.friction);
    [
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
    ]
}

/// To so many digits as a value is worth.
fn rounded(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return 0.0;
    }
    let scale = 10_f64.powi(DIGITS - 1 - value.abs().log10().floor() as i32);
    (value * scale).round() / scale
}
