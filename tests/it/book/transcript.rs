//! What a page tells its reader to write and to type: the blocks of files and of commands.
//!
//! | block | |
//! |---|---|
//! | ```` ```yaml robot.yaml ```` | a file under that name |
//! | ```` ```console ```` | `$ ` and a command, below it what it prints; `...` stands for anything, in a line or as lines; `^C` ends what runs |
//! | ```` ```console background ```` | the command goes on, as in a terminal of its own; what is shown is how its output begins |
//! | ```` ```console background wheels ```` | the same, and its terminal has a name |
//! | ```` ```console in wheels ```` | `^C` in that terminal |
//! | ```` ```console until ```` | repeated until it prints what is shown |
//! | ```` ```console fails ```` | the exit code is not 0 |
//! | ```` ```sh ```` | a script that succeeds, whatever it prints |
//! | ```` ```console no-run REASON ```` | not run: it needs what a test has not |

use pulldown_cmark::{CodeBlockKind, Event, Options, Parser, Tag, TagEnd};
use regex::Regex;

#[derive(Debug, PartialEq)]
pub enum Step {
    File {
        name: String,
        text: String,
    },
    Command {
        line: usize,
        command: String,
        printed: Option<String>,
        how: How,
        terminal: Option<String>,
    },
    /// Ctrl-C in a terminal: that of the name, or the one that was opened last.
    Interrupt {
        line: usize,
        terminal: Option<String>,
    },
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum How {
    Once,
    Fails,
    Until,
    Background,
}

/// The steps of a page in their order, or what its writer has to change.
pub fn steps(page: &str) -> Result<Vec<Step>, String> {
    let mut found = Vec::new();
    let mut block: Option<(String, usize, String)> = None;
    for (event, place) in Parser::new_ext(page, Options::ENABLE_TABLES).into_offset_iter() {
        match event {
            Event::Start(Tag::CodeBlock(CodeBlockKind::Fenced(info))) => {
                let line = page[..place.start].matches('\n').count() + 1;
                block = Some((info.into_string(), line, String::new()));
            }
            Event::Text(words) => {
                if let Some((_, _, text)) = &mut block {
                    text.push_str(&words);
                }
            }
            Event::End(TagEnd::CodeBlock) => {
                if let Some((info, line, text)) = block.take() {
                    let steps = steps_of_block(&info, line, text);
                    found.extend(steps.map_err(|why| format!("line {line}: {why}"))?);
                }
            }
            _ => {}
        }
    }
    Ok(found)
}

fn steps_of_block(info: &str, line: usize, text: String) -> Result<Vec<Step>, String> {
    let words: Vec<&str> = info.split([' ', ',']).filter(|it| !it.is_empty()).collect();
    let (kind, rest) = words.split_first().unwrap_or((&"", &[]));
    match (*kind, rest) {
        ("console" | "sh" | "bash", ["no-run"]) => Err("say why it is not run: `no-run REASON`".into()),
        ("console" | "sh" | "bash", ["no-run", ..]) => Ok(Vec::new()),
        ("console", []) => commands(line, &text, How::Once, None),
        ("console", ["background"]) => commands(line, &text, How::Background, None),
        ("console", ["background", name]) => commands(line, &text, How::Background, Some(name)),
        ("console", ["in", name]) => commands(line, &text, How::Once, Some(name)),
        ("console", ["until"]) => commands(line, &text, How::Until, None),
        ("console", ["fails"]) => commands(line, &text, How::Fails, None),
        ("sh" | "bash", []) => {
            Ok(vec![Step::Command { line, command: text, printed: None, how: How::Once, terminal: None }])
        }
        ("console" | "sh" | "bash", _) => {
            Err(format!("`{info}`: console with background, until, fails or no-run REASON"))
        }
        (_, [name]) if name.contains('.') => Ok(vec![Step::File { name: (*name).into(), text }]),
        _ => Ok(Vec::new()),
    }
}

fn commands(line: usize, text: &str, how: How, terminal: Option<&str>) -> Result<Vec<Step>, String> {
    let mut found = Vec::new();
    let terminal = terminal.map(str::to_owned);
    for (number, written) in text.lines().enumerate() {
        let line = line + number + 1;
        if let Some(command) = written.strip_prefix("$ ") {
            let printed = Some(String::new());
            found.push(Step::Command {
                line,
                command: command.into(),
                printed,
                how,
                terminal: terminal.clone(),
            });
            continue;
        }
        match found.last_mut() {
            _ if written == "^C" => found.push(Step::Interrupt { line, terminal: terminal.clone() }),
            Some(Step::Command { command, printed: Some(printed), .. }) => {
                if printed.is_empty() && command.ends_with('\\') {
                    command.push('\n');
                    command.push_str(written);
                } else {
                    printed.push_str(written);
                    printed.push('\n');
                }
            }
            _ => return Err("a block of commands begins with `$ `".into()),
        }
    }
    Ok(found)
}

/// The printed text as an expression that the whole output has to match; of a command that goes on, its beginning.
pub fn expected(printed: &str, goes_on: bool) -> Regex {
    let mut pattern = String::from("(?s)\\A");
    for line in printed.lines() {
        if line.trim() == "..." {
            pattern.push_str("(?:[^\\n]*(?:\\n|\\z))*?");
        } else {
            let parts: Vec<String> = line.trim_end().split("...").map(regex::escape).collect();
            pattern.push_str(&parts.join("[^\\n]*?"));
            pattern.push_str("[ \\t]*(?:\\n|\\z)");
        }
    }
    if !goes_on {
        pattern.push_str("\\z");
    }
    Regex::new(&pattern).expect("its parts are escaped")
}

#[test]
fn a_page_is_read_as_it_is_meant() {
    let page = "Write:\n```yaml robot.yaml\na: 1\n```\n```console\n$ ls \\\n  -a\none\n$ true\n```\n\
        ```console background\n$ serve\n...\n```\n```console no-run no such machine\n$ never\n```\n```console\n^C\n```\n";
    let command = |line, command: &str, printed: &str, how| Step::Command {
        line,
        command: command.into(),
        printed: Some(printed.into()),
        how,
        terminal: None,
    };
    let expected = [
        Step::File { name: "robot.yaml".into(), text: "a: 1\n".into() },
        command(6, "ls \\\n  -a", "one\n", How::Once),
        command(9, "true", "", How::Once),
        command(12, "serve", "...\n", How::Background),
        Step::Interrupt { line: 19, terminal: None },
    ];
    assert_eq!(steps(page).unwrap(), expected);
    for wrong in ["```console\nls\n```", "```console no-run\n$ ls\n```", "```console soon\n$ ls\n```"] {
        assert!(steps(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn dots_stand_for_anything() {
    let holds = |printed, output| expected(printed, false).is_match(output);
    assert!(holds("one ... three\n...\nend\n", "one 2 three\nx\ny\nend\n"));
    assert!(holds("...\nend\n", "end\n"));
    assert!(holds("...\n", ""));
    assert!(!holds("", "something\n"), "what is not shown must not be printed");
    assert!(!holds("one ... three\n", "one 2\n3 three\n"));
    assert!(!holds("a.c\n", "abc\n"));
    assert!(expected("begin\n", true).is_match("begin\nand more\n"));
}
