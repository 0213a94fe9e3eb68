//! Who was taken for whom.
//! Invariant: every judged case is in exactly one cell.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use super::Judged;
use crate::effect::NAMES;
use crate::plan::{Role, role_name};

/// A row for each thing that was there, a column for each that was said; right answers lie on the diagonal of names.
/// A pair stands in the row of the partner that was named, or else of the stronger one.
pub fn confusion(judged: &[Judged]) -> String {
    let mut cells: BTreeMap<(String, String), usize> = BTreeMap::new();
    for case in judged {
        let said = case.answer.says();
        let said = if said.is_empty() { "no answer" } else { said };
        *cells.entry((row_of(case), said.to_owned())).or_default() += 1;
    }
    let place = |name: &str| {
        let at = NAMES.iter().position(|(_, known)| *known == name).unwrap_or(NAMES.len());
        (at, name.to_owned())
    };
    let rows: BTreeSet<(usize, String)> = cells.keys().map(|(row, _)| place(row)).collect();
    let columns: Vec<(usize, String)> =
        cells.keys().map(|(_, said)| place(said)).collect::<BTreeSet<_>>().into_iter().collect();
    let mut text = String::from("who was taken for whom; a column is\n");
    let write = |text: &mut String, part: std::fmt::Arguments<'_>| {
        text.write_fmt(part).expect("a string takes all text");
    };
    for (number, (_, said)) in columns.iter().enumerate() {
        write(&mut text, format_args!("  {number:>2} {said}\n"));
    }
    write(&mut text, format_args!("{:28}", ""));
    for number in 0..columns.len() {
        write(&mut text, format_args!("{number:>4}"));
    }
    text.push('\n');
    for (_, row) in rows {
        write(&mut text, format_args!("{row:28}"));
        for (_, said) in &columns {
            match cells.get(&(row.clone(), said.clone())) {
                Some(count) => write(&mut text, format_args!("{count:>4}")),
                None => text.push_str("   ."),
            }
        }
        text.push('\n');
    }
    text
}

fn row_of(case: &Judged) -> String {
    let effects = &case.truth.effects;
    match case.truth.role {
        Role::Null | Role::Decoy => role_name(case.truth.role).to_owned(),
        Role::Unknown => format!("({})", effects[0].name),
        Role::Single | Role::Pair => {
            let named = effects.iter().find(|effect| effect.name == case.answer.says());
            let strongest = effects.iter().max_by(|a, b| a.d_prime.total_cmp(&b.d_prime));
            named.or(strongest).map_or_else(String::new, |effect| effect.name.clone())
        }
    }
}
