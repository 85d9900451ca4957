//! The program `cartpole`; see `cartpole --help`.

fn main() -> std::process::ExitCode {
    cartpole::program::run()
}
