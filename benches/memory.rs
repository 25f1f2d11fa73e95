//! How much memory a vehicle of 100,000 modules takes. `cargo bench --bench memory`.

mod vehicle;

fn resident_kib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux tells it there");
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).expect("every process has one");
    line.split_whitespace().nth(1).and_then(|kib| kib.parse().ok()).expect("a number of kB")
}

fn main() {
    for modules in [1_000, 10_000, 100_000] {
        let before = resident_kib();
        let engine = vehicle::running(modules);
        let after = resident_kib();
        println!(
            "{modules:>7} modules: {:.1} MB resident beyond the {:.1} MB before",
            (after - before) as f64 / 1024.0,
            before as f64 / 1024.0
        );
        drop(engine);
    }
}
