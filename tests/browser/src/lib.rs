//! A headless Chromium through its driver (WebDriver over HTTP), for the tests and pictures of the live page. Needs the programs
//! `chromium` and `chromedriver` on the search path.
#![forbid(unsafe_code)]

mod error;
mod wire;

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

pub use crate::error::BrowserError;
use crate::wire::{Method, ask};

/// A screen to show a page on.
#[derive(Debug, Clone, Copy)]
pub struct Screen {
    /// Width and height, CSS pixels.
    pub size: (u32, u32),
    /// A telephone: touched, and wide as it says.
    pub is_phone: bool,
    /// The system's colours are light.
    pub is_light: bool,
}

/// A browser with one page. It ends with this value.
#[derive(Debug)]
pub struct Browser {
    driver: Child,
    port: u16,
    session: String,
}

impl Browser {
    /// Starts one.
    ///
    /// # Errors
    /// [`BrowserError`] when driver or browser cannot be started.
    pub fn start() -> Result<Self, BrowserError> {
        let mut driver = Command::new("chromedriver")
            .arg("--port=0")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|error| {
                BrowserError(format!(
                    "chromedriver: {error}, expected the one of Debian's package chromium-driver (`cargo xtask test --all` installs it)"
                ))
            })?;
        let port = driver.stdout.take().and_then(|out| {
            let mut lines = BufReader::new(out).lines().map_while(Result::ok);
            let port = lines.find_map(|line| {
                line.rsplit_once("successfully on port ")?
                    .1
                    .trim_end_matches('.')
                    .parse()
                    .ok()
            });
            // What it says later must find a reader, or it would stop.
            thread::spawn(move || lines.for_each(drop));
            port
        });
        let mut browser = Self {
            driver,
            port: port.ok_or_else(|| {
                BrowserError("found no port of chromedriver, expected it to print one".to_owned())
            })?,
            session: String::new(),
        };
        // A root user's Chromium has no sandbox, and small machines have little shared memory.
        let arguments = [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--hide-scrollbars",
            "--no-first-run",
        ];
        let wanted = json!({"capabilities": {"alwaysMatch": {"goog:chromeOptions": {"args": arguments}}}});
        let session = ask(browser.port, Method::Post, "/session", &wanted)?;
        session["sessionId"]
            .as_str()
            .ok_or_else(|| BrowserError(format!("found {session}, expected a session")))?
            .clone_into(&mut browser.session);
        Ok(browser)
    }

    /// Sets screen and colours of the next page.
    ///
    /// # Errors
    /// [`BrowserError`] when the browser refuses.
    pub fn show_on(&self, screen: Screen) -> Result<(), BrowserError> {
        let (width, height) = screen.size;
        self.develop(
            "Emulation.setDeviceMetricsOverride",
            &json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": screen.is_phone}),
        )?;
        let scheme = if screen.is_light { "light" } else { "dark" };
        self.develop(
            "Emulation.setEmulatedMedia",
            &json!({"features": [{"name": "prefers-color-scheme", "value": scheme}]}),
        )
    }

    /// Opens an address and waits until it is loaded.
    ///
    /// # Errors
    /// [`BrowserError`] when it cannot be loaded.
    pub fn open(&self, address: &str) -> Result<(), BrowserError> {
        self.post("url", &json!({ "url": address })).map(drop)
    }

    /// What a script returns, such as `return document.title`.
    ///
    /// # Errors
    /// [`BrowserError`] with what the script threw.
    pub fn run(&self, script: &str) -> Result<Value, BrowserError> {
        self.post("execute/sync", &json!({"script": script, "args": []}))
    }

    /// Waits until a script returns something true, and returns it.
    ///
    /// # Errors
    /// [`BrowserError`] when it did not within `patience`.
    pub fn wait_for(&self, script: &str, patience: Duration) -> Result<Value, BrowserError> {
        let end = Instant::now() + patience;
        loop {
            let value = self.run(script)?;
            let is_true = !matches!(value, Value::Null | Value::Bool(false)) && value != "" && value != 0;
            if is_true {
                return Ok(value);
            }
            if Instant::now() > end {
                return Err(BrowserError(format!(
                    "found {value} after {patience:?}, expected `{script}` to be true; the page says: {}",
                    self.run("return document.body.innerText")?
                )));
            }
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// The text of the first element that a CSS selector finds.
    ///
    /// # Errors
    /// [`BrowserError`] when there is none.
    pub fn text(&self, selector: &str) -> Result<String, BrowserError> {
        let element = self.element(selector)?;
        let text = ask(
            self.port,
            Method::Get,
            &self.path(&format!("element/{element}/text")),
            &Value::Null,
        )?;
        Ok(text.as_str().unwrap_or_default().to_owned())
    }

    /// Clicks it as a person would: scrolled to, and only where nothing lies above it.
    ///
    /// # Errors
    /// [`BrowserError`] when it cannot be clicked.
    pub fn click(&self, selector: &str) -> Result<(), BrowserError> {
        let element = self.element(selector)?;
        self.post(&format!("element/{element}/click"), &json!({}))
            .map(drop)
    }

    /// Types into it, after what it held was taken out.
    ///
    /// # Errors
    /// [`BrowserError`] when nothing can be typed there.
    pub fn fill(&self, selector: &str, text: &str) -> Result<(), BrowserError> {
        let element = self.element(selector)?;
        self.post(&format!("element/{element}/clear"), &json!({}))?;
        self.post(&format!("element/{element}/value"), &json!({ "text": text }))
            .map(drop)
    }

    /// What the screen shows, as PNG.
    ///
    /// # Errors
    /// [`BrowserError`] when there is no picture.
    pub fn screenshot(&self) -> Result<Vec<u8>, BrowserError> {
        let picture = ask(self.port, Method::Get, &self.path("screenshot"), &Value::Null)?;
        STANDARD
            .decode(picture.as_str().unwrap_or_default())
            .map_err(|error| BrowserError(format!("screenshot: {error}, expected base64")))
    }

    fn element(&self, selector: &str) -> Result<String, BrowserError> {
        let found = self.post("element", &json!({"using": "css selector", "value": selector}))?;
        let element = found.as_object().and_then(|keys| keys.values().next()?.as_str());
        element
            .map(str::to_owned)
            .ok_or_else(|| BrowserError(format!("{selector}: found {found}, expected an element")))
    }

    /// A command of Chromium's own protocol.
    fn develop(&self, command: &str, parameters: &Value) -> Result<(), BrowserError> {
        self.post("goog/cdp/execute", &json!({"cmd": command, "params": parameters}))
            .map(drop)
    }

    fn post(&self, command: &str, body: &Value) -> Result<Value, BrowserError> {
        ask(self.port, Method::Post, &self.path(command), body)
    }

    fn path(&self, command: &str) -> String {
        format!("/session/{}/{command}", self.session)
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // The browser first: it would outlive its driver.
        if !self.session.is_empty() {
            let _ = ask(
                self.port,
                Method::Delete,
                &format!("/session/{}", self.session),
                &Value::Null,
            );
        }
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}
