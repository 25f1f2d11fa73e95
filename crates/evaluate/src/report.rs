//! The report of a campaign: tables as Markdown, and the curve of hidden faults against alarms as SVG.

use std::fmt::{Display, Write as _};

use super::campaign::{CURVE_MS, Results};
use super::figures::{self, Figure, Figures};
use super::learning::{Learning, Part, Score, TRIALS};
use super::live::Live;
use super::statistics::wilson;

/// The mark on the curve: how long a cause explains what begins after it, by default.
const DEFAULT_MS: u64 = 5_000;

/// The tables. Each figure has its interval of 95 % behind it.
pub fn markdown(results: &Results) -> String {
    let Results { machine, seeds, .. } = results;
    let mut out = format!("# The campaign: {machine}\n\n");
    let (first, last) = (seeds.start, seeds.end - 1);
    line(
        &mut out,
        format_args!(
            "`telltale evaluate --machine {machine} --seeds {first}..{last} --report DIR` made this page: {} trials with {} faults.\n",
            results.ours.len(),
            results.faults()
        ),
    );
    line(
        &mut out,
        "| Rule | First right | Precision | Recall | Rank | Alarms a fault |\n|---|---|---|---|---|---|",
    );
    for (name, trials) in results.rules() {
        let [first, precision, recall, rank, alarms, _] = figures::ratios(trials).map(shown);
        line(&mut out, format_args!("| {name} | {first} | {precision} | {recall} | {rank} | {alarms} |"));
    }
    line(
        &mut out,
        "\n| Rule | Time to the cause, p50 | p95 | Hidden faults | Hidden for |\n|---|---|---|---|---|",
    );
    for (name, trials) in results.rules() {
        let [p50, p95] = figures::times(trials).map(|it| shown(scaled(it, 1e-3)));
        let [count, _, seconds] = figures::hidden(trials).map(shown);
        line(&mut out, format_args!("| {name} | {p50} s | {p95} s | {count} | {seconds} s |"));
    }
    line(&mut out, "\n| Ours | Count |\n|---|---|");
    let beyond = figures::hidden(&results.ours)[1];
    for figure in figures::counts(&results.ours)
        .into_iter()
        .chain([Figure { name: "hidden beyond `within`", ..beyond }])
    {
        line(&mut out, format_args!("| {} | {} |", figure.name.replace('_', " "), shown(figure)));
    }
    line(
        &mut out,
        "\n| Against | Only ours first right | Only the other | p (McNemar) | p of the times (Wilcoxon) |\n|---|---|---|---|---|",
    );
    for it in results.comparisons() {
        line(
            &mut out,
            format_args!(
                "| {} | {} | {} | {} | {} |",
                it.rule.name(),
                it.only_ours,
                it.only_other,
                probability(it.first_right_p),
                probability(it.time_p)
            ),
        );
    }
    line(&mut out, "\n| A cause explains | Hidden faults | Hidden for | Alarms a fault |\n|---|---|---|---|");
    for (ms, trials) in CURVE_MS.iter().zip(&results.curve) {
        let ([count, _, seconds], [.., alarms, _]) =
            (figures::hidden(trials).map(shown), figures::ratios(trials).map(shown));
        let mark = if *ms == DEFAULT_MS { " (default)" } else { "" };
        line(
            &mut out,
            format_args!("| {} s{mark} | {count} | {seconds} s | {alarms} |", *ms as f64 / 1000.0),
        );
    }
    line(&mut out, format_args!("\n![Hidden faults against alarms]({machine}-curve.svg)"));
    if let Some(live) = &results.live {
        out += &in_real_time(live);
    }
    out
}

/// The trials that ran in real time beside the same ones in virtual time.
fn in_real_time(live: &Live) -> String {
    let mut out = "\n## Live\n\n".to_owned();
    let (trials, faults) = (live.ours.len(), Figures::sum(&live.ours).faults);
    line(
        &mut out,
        format_args!(
            "{trials} of the trials, with {faults} faults, in real time over DDS. Runs that the computer held up for longer \
             than 0.2 s were made again: {}. Trials without a run that counts: {}.\n",
            live.repeated,
            live.left_out.len()
        ),
    );
    line(&mut out, "| | Live | The same trials in virtual time |\n|---|---|---|");
    let all = |trials: &[Figures]| -> Vec<Figure> {
        let times = figures::times(trials).map(|it| scaled(it, 1e-3));
        let names = ["time to the cause, p50 (s)", "time to the cause, p95 (s)"];
        let times = times.into_iter().zip(names).map(|(it, name)| Figure { name, ..it });
        let names = ["hidden", "hidden beyond `within`", "hidden for (s)"];
        let hidden = figures::hidden(trials).into_iter().zip(names).map(|(it, name)| Figure { name, ..it });
        figures::ratios(trials)
            .into_iter()
            .chain(times)
            .chain(figures::counts(trials))
            .chain(hidden)
            .collect()
    };
    for (ours, other) in all(&live.ours).into_iter().zip(all(&live.in_virtual_time)) {
        let name = ours.name.replace('_', " ");
        line(&mut out, format_args!("| {name} | {} | {} |", shown(ours), shown(other)));
    }
    out
}

/// How well the dependencies are learned.
pub fn learning(learning: &Learning) -> String {
    let Learning { machine, seeds, .. } = learning;
    let mut out = format!("# Dependencies learned: {machine}\n\n");
    let (first, last) = (seeds.start, seeds.end - 1);
    line(
        &mut out,
        format_args!(
            "`telltale evaluate --machine {machine} --seeds {first}..{last} --report DIR` made this page, too. \
             Each share is that of all pasts of so many trials that the seeds give, with its interval of 95 % as if every \
             edge were a sample of its own.\n"
        ),
    );
    line(
        &mut out,
        "| Trials | Pasts | Precision, direct | Precision, transitive | Recall | Reversed | Of one component |\n|---|---|---|---|---|---|---|",
    );
    let row = |trials: &str, pasts: u64, score: &Score| {
        let Score { learned, together, right, direct, reversed, known, found } = *score;
        let [direct, right] = [direct, right].map(|part| share(Part { part, whole: learned }));
        let recall = share(Part { part: found, whole: known });
        format!("| {trials} | {pasts} | {direct} | {right} | {recall} | {reversed} | {together} |")
    };
    for (trials, pasts, score) in &learning.curve {
        line(&mut out, row(&trials.to_string(), *pasts, score));
    }
    let drawn = row(&format!("{TRIALS}, drawn configurations"), learning.pasts_drawn, &learning.drawn);
    line(&mut out, drawn);
    line(&mut out, "\n| | Count |\n|---|---|");
    for (name, part) in [
        ("hidden dependencies that the proposals restore", learning.hidden),
        ("causes that are doubted, and have no effect there", learning.doubted),
        ("pasts of faults without an effect, from which anything is learned", learning.independent),
        ("shuffled pasts from which anything is learned", learning.shuffled),
    ] {
        line(&mut out, format_args!("| {name} | {} of {} |", part.part, part.whole));
    }
    out
}

fn share(part: Part) -> String {
    let (low, high) = wilson(part.part, part.whole);
    let value = (part.whole > 0).then(|| part.part as f64 / part.whole as f64);
    shown(Figure { name: "", value, low, high })
}

fn line(out: &mut String, text: impl Display) {
    // Writing to a string cannot fail.
    let _ = writeln!(out, "{text}");
}

fn shown(Figure { value, low, high, .. }: Figure) -> String {
    match value {
        Some(value) => format!("{} ({} to {})", number(value), number(low), number(high)),
        None => "none".into(),
    }
}

fn number(value: f64) -> String {
    let text = if value >= 10.0 { format!("{value:.1}") } else { format!("{value:.2}") };
    text.strip_suffix(".00").map_or(text.clone(), str::to_owned)
}

fn scaled(figure: Figure, by: f64) -> Figure {
    Figure { value: figure.value.map(|it| it * by), low: figure.low * by, high: figure.high * by, ..figure }
}

fn probability(p: f64) -> String {
    if p < 0.001 { "< 0.001".into() } else { format!("{p:.3}") }
}

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 320.0;
const MARGIN: f64 = 56.0;

/// Hidden seconds a fault from left to right, alarms a fault from bottom to top: a point for each limit.
pub fn curve(results: &Results) -> String {
    let points: Vec<(u64, f64, f64)> = CURVE_MS
        .iter()
        .zip(&results.curve)
        .map(|(ms, trials)| {
            let sum = Figures::sum(trials);
            let faults = sum.faults.max(1) as f64;
            (*ms, sum.hidden_ms as f64 / 1000.0 / faults, sum.alarms as f64 / faults)
        })
        .collect();
    let most = |of: fn(&(u64, f64, f64)) -> f64| points.iter().map(of).fold(0.0, f64::max).max(0.01) * 1.1;
    let (most_x, most_y) = (most(|it| it.1), most(|it| it.2));
    let x = |value: f64| MARGIN + value / most_x * (WIDTH - 2.0 * MARGIN);
    let y = |value: f64| HEIGHT - MARGIN - value / most_y * (HEIGHT - 2.0 * MARGIN);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#fff\"/>\n"
    );
    let axes = [
        format!("M{MARGIN} {MARGIN}V{0}H{1}", HEIGHT - MARGIN, WIDTH - MARGIN),
        points.iter().enumerate().fold(String::new(), |path, (index, (_, hidden, alarms))| {
            format!("{path}{}{:.1} {:.1}", if index == 0 { 'M' } else { 'L' }, x(*hidden), y(*alarms))
        }),
    ];
    for path in axes {
        line(&mut out, format_args!("<path d=\"{path}\" fill=\"none\" stroke=\"#333\"/>"));
    }
    for (ms, hidden, alarms) in &points {
        let fill = if *ms == DEFAULT_MS { "#c00" } else { "#333" };
        let (x, y) = (x(*hidden), y(*alarms));
        line(&mut out, format_args!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{fill}\"/>"));
        let default = if *ms == DEFAULT_MS { ", default" } else { "" };
        line(
            &mut out,
            format_args!(
                "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{fill}\">{} s{default}</text>",
                x + 6.0,
                y - 6.0,
                *ms as f64 / 1000.0
            ),
        );
    }
    for (at_x, at_y, anchor, text) in [
        (MARGIN, HEIGHT - MARGIN + 16.0, "middle", "0".to_owned()),
        (WIDTH - MARGIN, HEIGHT - MARGIN + 16.0, "end", format!("{most_x:.2} s")),
        (WIDTH / 2.0, HEIGHT - 12.0, "middle", "A fault is hidden for, on average".to_owned()),
        (MARGIN - 6.0, MARGIN + 4.0, "end", format!("{most_y:.1}")),
        (MARGIN, MARGIN - 16.0, "start", format!("Alarms a fault ({})", results.machine)),
    ] {
        line(
            &mut out,
            format_args!("<text x=\"{at_x}\" y=\"{at_y}\" text-anchor=\"{anchor}\">{text}</text>"),
        );
    }
    out + "</svg>\n"
}
