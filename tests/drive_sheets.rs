//! Promise: the sheets in `firmware-config/` state every object of a sheet, each at its address and
//! in its unit, with values a board can have; and the README shows the hash they have.

use quadrant::rt::drive::sheet::{SHEET, Sheet};
use quadrant::rt::wire::parameter::Object;

const SHEET_TEXT: &str = include_str!("../firmware-config/encoder-board.toml");
const README: &str = include_str!("../firmware-config/README.md");

/// Every entry of the file by its key, whatever its section.
fn entries() -> toml::Table {
    let sections: toml::Table = SHEET_TEXT.parse().expect("the sheet is TOML");
    sections.into_iter().flat_map(|(_, section)| section.as_table().cloned().unwrap_or_default()).collect()
}

fn value(object: Object) -> u32 {
    let entries = entries();
    let entry = entries.get(object.key()).unwrap_or_else(|| panic!("the sheet has no {object}"));
    assert_eq!(entry["object"].as_str(), Some(object.address().to_string().as_str()), "{object}");
    assert_eq!(entry["unit"].as_str(), Some(object.unit()), "{object}");
    let value = entry["value"].as_integer().unwrap_or_else(|| panic!("{object} is no integer"));
    u32::try_from(value).unwrap_or_else(|_| panic!("{object} is {value}, which is no u32"))
}

#[test]
fn the_sheet_states_every_object_and_no_other() {
    let sheet = Sheet::from_values(value).unwrap_or_else(|error| panic!("{error}"));
    for object in SHEET {
        assert_eq!(sheet.value(object), Some(value(object)), "{object}");
    }
    assert_eq!(entries().len(), SHEET.len(), "entries of the sheet");
}

#[test]
fn the_readme_shows_the_hash_of_the_sheet() {
    let sheet = Sheet::from_values(value).unwrap_or_else(|error| panic!("{error}"));
    let hash = format!("{:08x}", sheet.firmware_config_hash());
    assert!(README.contains(&format!("the hash is `{hash}`")), "README does not show the hash {hash}");
}
