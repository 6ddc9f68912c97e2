//! The binary `hksl`.

use std::process::ExitCode;

fn main() -> ExitCode {
    hksl_cli::prepare();
    let arguments = std::env::args_os().skip(1).collect();
    hksl_cli::run(&hksl_cli::Invocation { arguments, program: None }).into()
}
