//! The binary as a parent process meets it: the pipe's talk, exit codes, and errors on standard error alone.

mod common;

use std::io::Write;
use std::process::{Child, Command, Output, Stdio};

use common::{FLASH, elf_at};
use gripline_emulator::wire::{Reply, Request, read_greeting};

fn emulator(arguments: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_gripline-emulator"))
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// What the program leaves behind when its standard input closes at once.
fn left_behind(arguments: &[&str]) -> Output {
    emulator(arguments).wait_with_output().unwrap()
}

/// A file of this test's own, gone with it.
struct Scratch(std::path::PathBuf);

impl Scratch {
    fn new(name: &str, bytes: &[u8]) -> Self {
        let path = std::env::temp_dir().join(format!("gripline-emulator-{}-{name}", std::process::id()));
        std::fs::write(&path, bytes).unwrap();
        Self(path)
    }

    fn path(&self) -> &str {
        self.0.to_str().unwrap()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        std::fs::remove_file(&self.0).unwrap();
    }
}

/// Turns DAC channel 1 on, writes 1000 to it and sleeps.
const CODE: [u16; 18] = [
    0x4805, 0x4906, 0x6001, // ldr r0, =RCC_APB1ENR; ldr r1, =DACEN; str r1, [r0]
    0x4806, 0x2101, 0x6001, // ldr r0, =DAC; movs r1, #EN1; str r1, [r0]
    0x21FA, 0x0089, 0x6081, // movs r1, #250; lsls r1, r1, #2; str r1, [r0, #DHR12R1]
    0xBF30, 0xE7FD, 0xBF00, // 0: wfi; b 0b; nop
    0x3840, 0x4002, 0x0000, 0x2000, 0x7400, 0x4000,
];

fn image() -> Vec<u8> {
    elf_at(FLASH, &CODE)
}

#[test]
fn a_parent_boots_an_image_lets_time_pass_and_reads_the_line() {
    let file = Scratch::new("boots.elf", &image());
    let mut child = emulator(&["--image", file.path()]);
    let (mut to, mut from) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
    read_greeting(&mut from).unwrap();
    let mut ask = |advance_ns| {
        Request {
            advance_ns,
            uart_bytes: vec![1, 2],
            ..Request::default()
        }
        .write(&mut to)
        .unwrap();
        Reply::read(&mut from).unwrap()
    };
    let nothing_run = ask(0);
    assert_eq!(nothing_run, Reply::default());
    let booted = ask(1_000_000);
    assert!(
        booted.now_ns >= 1_000_000 && booted.instructions >= 9,
        "{booted:?}"
    );
    assert_eq!((booted.dac_code, booted.resets), (1000, 0));
    assert_eq!(
        booted
            .line_writes
            .iter()
            .map(|write| write.code)
            .collect::<Vec<_>>(),
        [0, 1000]
    );
    let later = ask(1_000_000);
    assert!(later.now_ns >= 2_000_000, "{later:?}");
    assert_eq!((later.dac_code, later.line_writes), (1000, vec![]));
    drop(to);
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), output.stderr), (Some(0), vec![]));
}

#[test]
fn an_image_that_cannot_run_ends_with_code_1_one_line_and_an_untouched_pipe() {
    let text_file = Scratch::new("text.elf", b"not an image");
    let ram_file = Scratch::new("ram.elf", &elf_at(0x2000_0000, &CODE));
    for (path, words) in [
        ("no/such/file.elf", ["no/such/file.elf", "cannot read"]),
        (text_file.path(), ["expected an ELF file", "6e, 6f, 74, 20"]),
        (ram_file.path(), ["0x08000000", "found 0x20000000..0x2000002c"]),
    ] {
        let output = left_behind(&["--image", path]);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), output.stdout), (Some(1), vec![]), "{text}");
        assert!(
            words.iter().all(|word| text.contains(word)) && text.lines().count() == 1,
            "{text}"
        );
    }
}

#[test]
fn wrong_usage_ends_with_code_2_and_says_what_was_expected() {
    for (arguments, words) in [
        (&[][..], "--image: expected a firmware image, found none"),
        (&["--image"], "--image: expected a file after it, found nothing"),
        (&["--imgae", "x"], "expected an option, found --imgae"),
    ] {
        let output = left_behind(arguments);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), output.stdout), (Some(2), vec![]), "{text}");
        assert!(text.contains(words) && text.contains("usage:"), "{text}");
    }
}

#[test]
fn a_request_that_makes_no_sense_ends_with_code_1_and_names_it() {
    let file = Scratch::new("nonsense.elf", &image());
    let mut child = emulator(&["--image", file.path()]);
    child.stdin.take().unwrap().write_all(&[1, 0, 0, 0, 77]).unwrap();
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(text.contains("expected a request, found other bytes"), "{text}");
}

#[test]
fn the_log_and_the_gaps_are_left_behind_on_request() {
    let mut without_clock = CODE;
    without_clock[14..16].fill(0); // DACEN
    let file = Scratch::new("gaps.elf", &elf_at(FLASH, &without_clock));
    let log = Scratch::new("gaps.log", b"from an earlier run");
    let mut child = emulator(&["--image", file.path(), "--gaps", "--log", log.path()]);
    let request = Request {
        advance_ns: 1_000_000,
        ..Request::default()
    };
    request.write(child.stdin.as_mut().unwrap()).unwrap();
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert!(
        text.contains("DAC") && text.contains("RCC.APB1ENR.DACEN"),
        "{text}"
    );
    assert_eq!(std::fs::read(&log.0).unwrap(), b"", "this image has no log");
}
