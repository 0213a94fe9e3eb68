//! The daemon. See `quadrantd --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    quadrant::service::main()
}
