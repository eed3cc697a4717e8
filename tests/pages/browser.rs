//! Pages in a real browser: Chromium without a window, over its DevTools protocol.
#![allow(dead_code, reason = "every program of tests uses its own part")]

use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

/// A browser of its own, with a profile of its own; it ends with the value.
pub struct Browser {
    child: Child,
    socket: WebSocket<MaybeTlsStream<TcpStream>>,
    next: u64,
    /// What came that was no answer.
    events: Vec<Value>,
    _profile: tempfile::TempDir,
}

/// One open page.
pub struct Page<'b> {
    browser: &'b mut Browser,
    session: String,
}

const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

impl Browser {
    /// Starts Chromium; says so and returns `None` where none is installed.
    pub fn start() -> Option<Self> {
        let installed =
            |name: &&&str| Command::new(name).arg("--version").output().is_ok_and(|out| out.status.success());
        let Some(name) = NAMES.iter().find(installed) else {
            eprintln!("skipped: no Chromium is installed (none of {NAMES:?})");
            return None;
        };
        let profile = tempfile::tempdir().unwrap();
        let mut child = Command::new(name)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
            .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
            .arg("--remote-debugging-port=0")
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let address =
            lines.by_ref().find_map(|line| Some(line.ok()?.strip_prefix("DevTools listening on ")?.to_owned()));
        // The rest of what it says is not needed, but must be read.
        std::thread::spawn(move || lines.for_each(drop));
        let (socket, _) = tungstenite::connect(address.unwrap()).unwrap();
        Some(Self { child, socket, next: 0, events: Vec::new(), _profile: profile })
    }

    fn call(&mut self, session: Option<&str>, method: &str, params: Value) -> Value {
        self.next += 1;
        let mut request = json!({ "id": self.next, "method": method, "params": params });
        if let Some(session) = session {
            request["sessionId"] = session.into();
        }
        self.socket.send(Message::text(request.to_string())).unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else { continue };
            let answer: Value = serde_json::from_str(&text).unwrap();
            if answer["id"] == self.next {
                assert_eq!(answer["error"], Value::Null, "{method}");
                return answer["result"].clone();
            }
            self.events.push(answer);
        }
    }

    /// Opens a page in a window of that size.
    pub fn open(&mut self, file: &Path, [width, height]: [u32; 2], dark: bool) -> Page<'_> {
        self.events.clear();
        let target = self.call(None, "Target.createTarget", json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = self.call(None, "Target.attachToTarget", attach)["sessionId"].as_str().unwrap().to_owned();
        let mut page = Page { browser: self, session };
        for domain in ["Page", "Runtime", "Log", "Network"] {
            page.call(&format!("{domain}.enable"), json!({}));
        }
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600 });
        page.call("Emulation.setDeviceMetricsOverride", size);
        let scheme = json!({ "name": "prefers-color-scheme", "value": if dark { "dark" } else { "light" } });
        let still = json!({ "name": "prefers-reduced-motion", "value": "reduce" });
        page.call("Emulation.setEmulatedMedia", json!({ "features": [scheme, still] }));
        page.call("Page.navigate", json!({ "url": format!("file://{}", file.display()) }));
        page
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Page<'_> {
    pub fn call(&mut self, method: &str, params: Value) -> Value {
        let session = self.session.clone();
        self.browser.call(Some(&session), method, params)
    }

    /// The value of an expression, waited for where it is a promise.
    #[track_caller]
    pub fn value(&mut self, expression: &str) -> Value {
        let params = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let answer = self.call("Runtime.evaluate", params);
        assert_eq!(answer["exceptionDetails"], Value::Null, "{expression}");
        answer["result"]["value"].clone()
    }

    /// Waits until a condition holds, looking at every drawn frame; gives up after a minute.
    #[track_caller]
    pub fn wait_for(&mut self, condition: &str) {
        let script = format!(
            "new Promise((done) => {{ const end = performance.now() + 60000;
               const look = () => {condition} ? done(true) : performance.now() > end ? done(false) : requestAnimationFrame(look);
               look(); }})"
        );
        assert_eq!(self.value(&script), true, "waited for: {condition}");
    }

    /// Moves the mouse to a point of the window.
    pub fn hover(&mut self, [x, y]: [f64; 2]) {
        self.call("Input.dispatchMouseEvent", json!({ "type": "mouseMoved", "x": x, "y": y }));
    }

    /// Presses and lets go of a key.
    pub fn key(&mut self, key: &str) {
        for kind in ["keyDown", "keyUp"] {
            self.call("Input.dispatchKeyEvent", json!({ "type": kind, "key": key }));
        }
    }

    /// Presses a key as a keyboard does, so that the browser acts on it: Tab (9), Enter (13), space (32).
    pub fn press(&mut self, key: &str, code: u32) {
        let text = if key == "Enter" { "\r" } else { key };
        let mut down = json!({ "type": "keyDown", "key": key, "windowsVirtualKeyCode": code });
        if key != "Tab" {
            down["text"] = text.into();
        }
        self.call("Input.dispatchKeyEvent", down);
        self.call("Input.dispatchKeyEvent", json!({ "type": "keyUp", "key": key, "windowsVirtualKeyCode": code }));
    }

    /// Everything that the page or the browser said about it, and every address it asked for besides its own.
    pub fn complaints(&mut self) -> Vec<String> {
        // An answer comes after all events before it.
        let own = self.value("location.href");
        let session = &self.session;
        let events = self.browser.events.iter().filter(|event| event["sessionId"] == **session);
        let complaint = |event: &Value| {
            let url = &event["params"]["request"]["url"];
            match event["method"].as_str().unwrap_or_default() {
                "Runtime.consoleAPICalled" | "Runtime.exceptionThrown" | "Log.entryAdded" => Some(event.to_string()),
                "Network.requestWillBeSent"
                    if *url != own && !url.as_str().is_some_and(|url| url.starts_with("data:")) =>
                {
                    Some(url.to_string())
                }
                _ => None,
            }
        };
        events.filter_map(complaint).collect()
    }
}
