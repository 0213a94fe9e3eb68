//! Promise: every fault has its page in `docs/faults/`, under its number and name, with all that an
//! operator needs; and the index lists it with the stop it causes.

use std::path::PathBuf;

use quadrant::base::fault::{Fault, StopCategory};

fn read(page: &str) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("docs/faults").join(page);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn page_of(fault: Fault) -> String {
    format!("{:02}-{}.md", fault.number(), fault.name())
}

#[test]
fn every_fault_has_a_page_with_all_its_parts() {
    for fault in Fault::ALL {
        let page = read(&page_of(fault));
        let title = format!("# Fault {}: {}\n", fault.number(), fault.name());
        assert!(page.starts_with(&title), "the page of {fault} does not start with {title}");
        let category = match fault.stop() {
            StopCategory::Controlled => "Stop category 1 ",
            StopCategory::Immediate => "Stop category 0 ",
        };
        assert!(page.contains(category), "the page of {fault} does not say {category}");
        for part in [
            "What it means",
            "What the axis does",
            "Likely causes",
            "What to check",
            "How to clear it",
            "Settings that govern it",
        ] {
            let (_, text) = page
                .split_once(&format!("\n## {part}\n\n"))
                .unwrap_or_else(|| panic!("the page of {fault} has no part '{part}'"));
            let text = text.split("\n## ").next().unwrap_or_default();
            assert!(text.trim().len() > 4, "the page of {fault} says nothing about '{part}'");
        }
    }
}

#[test]
fn the_index_lists_every_page_and_its_stop() {
    let index = read("README.md");
    for fault in Fault::ALL {
        let stop = match fault.stop() {
            StopCategory::Controlled => "controlled",
            StopCategory::Immediate => "immediate",
        };
        let row = format!("| {} | [{}]({}) | {stop} |\n", fault.number(), fault.name(), page_of(fault));
        assert!(index.contains(&row), "the index has no row {row}");
    }
}
