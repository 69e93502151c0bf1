//! The live page in a real browser: what it shows of a run, and what its buttons do. Only `cargo xtask test --all` runs these; it
//! installs Chromium and its driver.

mod slow {
    use std::io::{BufRead as _, BufReader, Read as _, Write as _};
    use std::net::TcpStream;
    use std::process::{Child, Command, Stdio};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::{Duration, Instant};

    use gripline_browser::{Browser, Screen};
    use serde_json::Value;

    use crate::serial_board::{Line, SerialBoard};

    const DESKTOP: Screen = Screen {
        size: (1_280, 900),
        is_phone: false,
        is_light: false,
    };
    const PHONE: Screen = Screen {
        size: (360, 740),
        is_phone: true,
        is_light: true,
    };
    const PATIENCE: Duration = Duration::from_secs(30);
    const SHOWS_SLIP: &str = "return ['INCIPIENT', 'SLIP'].includes(document.getElementById('state').dataset.state) \
                              && document.getElementById('scene').textContent";

    /// A run that serves its page, until the end of the test.
    struct Run {
        child: Child,
        address: String,
        token: String,
        _state: tempfile::TempDir,
    }

    impl Run {
        fn start(arguments: &[&str]) -> Self {
            let state = tempfile::tempdir().unwrap();
            let mut child = Command::new(env!("CARGO_BIN_EXE_gripline"))
                .args(["run", "--seconds", "600", "--serve", "127.0.0.1:0"])
                .args(arguments)
                .env("XDG_STATE_HOME", state.path())
                .env_remove("STATE_DIRECTORY")
                .stdout(Stdio::null())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            let mut said = BufReader::new(child.stderr.take().unwrap())
                .lines()
                .map_while(Result::ok);
            let address = said
                .find_map(|line| Some(format!("http://{}", line.split_once("http://")?.1.trim())))
                .expect("it says where it serves");
            std::thread::spawn(move || said.for_each(|line| eprintln!("{line}")));
            let token = std::fs::read_to_string(state.path().join("gripline/token")).unwrap();
            Self {
                child,
                address,
                token: token.trim().to_owned(),
                _state: state,
            }
        }

        /// What programs are told.
        fn status(&self) -> Value {
            let host = self.address.strip_prefix("http://").unwrap();
            let mut stream = TcpStream::connect(host).unwrap();
            write!(stream, "GET /status HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
            let mut answer = String::new();
            stream.read_to_string(&mut answer).unwrap();
            serde_json::from_str(answer.split_once("\r\n\r\n").unwrap().1).unwrap()
        }

        fn end(&mut self) {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }

    impl Drop for Run {
        fn drop(&mut self) {
            self.end();
        }
    }

    /// Waits for an answer with this in it.
    fn answered(browser: &Browser, words: &str) {
        let script = format!("return document.getElementById('answers').textContent.includes('{words}')");
        browser.wait_for(&script, PATIENCE).unwrap();
    }

    fn says(browser: &Browser, words: &str) {
        let script = format!("return document.getElementById('alarm').textContent.includes('{words}')");
        browser.wait_for(&script, PATIENCE).unwrap();
    }

    /// A click on release opens the gripper: the line falls to nothing, on the page and for programs.
    fn release(browser: &Browser, run: &Run) {
        browser
            .wait_for(
                "return parseFloat(document.getElementById('line').textContent) > 1",
                PATIENCE,
            )
            .unwrap();
        browser.click("[data-action=release]").unwrap();
        answered(browser, "release: done");
        browser
            .wait_for(
                "return document.getElementById('line').textContent === '0.00 N'",
                PATIENCE,
            )
            .unwrap();
        let status = run.status();
        assert_eq!(
            (status["mode"].as_str(), status["requested"].as_str()),
            (Some("released"), Some("released")),
            "{status}"
        );
        let owner = browser
            .run("return document.getElementById('client').value")
            .unwrap();
        assert_eq!(status["owner"], owner);
    }

    #[test]
    #[ignore = "needs Chromium: cargo xtask test --all"]
    fn the_page_shows_slip_when_the_world_slips_and_a_click_releases() {
        let mut run = Run::start(&[]);
        let browser = Browser::start().unwrap();
        browser.show_on(DESKTOP).unwrap();
        browser.open(&run.address).unwrap();
        let scene = browser.wait_for(SHOWS_SLIP, PATIENCE).unwrap();
        println!("shown while the world is at: {scene}");

        // A wrong token is refused, and moves nothing.
        browser.fill("#token", "not-the-token").unwrap();
        browser.click("[data-action=release]").unwrap();
        answered(&browser, "release: refused, wrong token");
        assert_ne!(run.status()["requested"], "released");

        // The token may come with the address, and does not stay there.
        browser
            .open(&format!("{}/#token={}", run.address, run.token))
            .unwrap();
        browser
            .wait_for(
                "return location.hash === '' && document.getElementById('token').value.length > 16",
                PATIENCE,
            )
            .unwrap();
        release(&browser, &run);

        // On a telephone nothing is wider than its screen.
        browser.show_on(PHONE).unwrap();
        let width = browser
            .run("return document.documentElement.scrollWidth")
            .unwrap();
        assert!(width.as_f64().unwrap() <= 360.0, "{width} pixels wide");

        run.end();
        says(&browser, "NO CONNECTION");
    }

    #[test]
    #[ignore = "needs Chromium, the emulator and the image: cargo xtask test --all"]
    fn the_emulated_board_slips_on_the_page_and_a_click_releases_it() {
        let run = Run::start(&["--mcu", "emulator"]);
        let browser = Browser::start().unwrap();
        browser
            .open(&format!("{}/#token={}", run.address, run.token))
            .unwrap();
        browser.wait_for(SHOWS_SLIP, 4 * PATIENCE).unwrap();
        release(&browser, &run);
        let link = browser.text("#link").unwrap();
        assert!(link.contains("emula"), "{link}");
    }

    #[test]
    #[ignore = "needs Chromium: cargo xtask test --all"]
    fn a_cable_that_is_pulled_out_shows() {
        let mut line = Line::new();
        let path = format!("serial:{}", line.name());
        let pull = Arc::new(AtomicBool::new(false));
        let pulled = Arc::clone(&pull);
        let board = std::thread::spawn(move || {
            let begun = Instant::now();
            SerialBoard::new(0).serve(&mut line, |_| {
                pulled.load(Ordering::Relaxed) || begun.elapsed() > 4 * PATIENCE
            });
        });
        let run = Run::start(&["--mcu", &path]);
        let browser = Browser::start().unwrap();
        browser.open(&run.address).unwrap();
        browser
            .wait_for(
                "return Number(document.getElementById('frame').textContent) > 10",
                PATIENCE,
            )
            .unwrap();
        assert!(
            browser
                .run("return document.getElementById('alarm').hidden")
                .unwrap()
                .as_bool()
                .unwrap()
        );
        pull.store(true, Ordering::Relaxed);
        board.join().unwrap();
        says(&browser, "LINK LOST");
        let faults = browser.text("#faults").unwrap();
        assert!(
            faults.contains("NO DEVICE") && faults.contains("cable"),
            "{faults}"
        );
    }
}
