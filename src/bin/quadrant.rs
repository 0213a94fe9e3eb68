//! The tool. See `quadrant --help`.

use std::process::ExitCode;

fn main() -> ExitCode {
    quadrant::cli::main()
}
