# Short names for what is typed often. `just` lists them.

default:
    @just --list --unsorted

# A circular test on the simulated reference machine; options as of `quadrant circle --help`
circle *options:
    cargo run --release -- circle {{ options }}

# Everything that must hold before a change is taken: exactly what the server runs
check:
    .ci/run

# The quick half of it, while working
quick:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets -- -D warnings
    cargo test --workspace

# Time per cycle, plant and log; the figures of the README
bench *options:
    cargo bench {{ options }}
