//! The program. All of it stands in the library, where tests and benchmarks reach it.

fn main() -> std::process::ExitCode {
    telltale::cli::main()
}
