//! Promise: what is thousands of times the noise is named by itself, with its value to a thousandth.

use quadrant::config;
use quadrant::offline::gap::show::verdict::Verdict;

use super::{analysed, runs};

#[test]
#[ignore = "seconds only if optimised; run by .ci/run"]
fn what_is_thousands_of_times_the_noise_is_named_by_itself() {
    let machine = config::load("paper").expect("a machine");
    for (law, amplitude, name) in [
        ("servo-gain-mismatch", -13.0, "servo-gain-mismatch"),
        ("command-filter-by-rows", 5.0, "command-filter"),
    ] {
        let analysis = analysed(&machine, &runs(&machine, &[(law, amplitude)]));
        let [axis] = analysis.axes.as_slice() else { panic!("one axis") };
        let names: Vec<&str> = axis.named.effects.iter().map(|effect| effect.name).collect();
        assert_eq!((axis.verdict, names), (Verdict::Named, vec![name]), "{law}");
        let (key, value, _) = axis.named.model.effect(0)[0];
        assert!((value / amplitude - 1.0).abs() < 1e-3, "{law}: {key} {value}, {amplitude} hidden");
    }
}
