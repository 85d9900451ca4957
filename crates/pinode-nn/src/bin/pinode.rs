//! The program `pinode`; see `pinode --help`.

fn main() -> std::process::ExitCode {
    pinode_nn::cli::run()
}
