//! A headless Chromium, controlled over its debugging socket, to view a page as a user would.

use base64::Engine;
use serde_json::{Value, json};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket};

/// Path of a Chromium; without it the usual names are tried.
const NAMED: &str = "CHROMIUM";
/// When set, a missing browser is a failure.
const REQUIRED: &str = "BROWSER_REQUIRED";

/// Path of a browser; `None` with a message if there is none and none is required.
pub fn browser() -> Option<PathBuf> {
    if let Some(path) = std::env::var_os(NAMED) {
        return Some(path.into());
    }
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let names = [
        "chromium",
        "chromium-browser",
        "google-chrome",
        "google-chrome-stable",
        "chrome",
    ];
    let found = names.iter().find_map(|name| {
        std::env::split_paths(&folders)
            .map(|folder| folder.join(name))
            .find(|path| path.is_file())
    });
    assert!(
        found.is_some() || std::env::var_os(REQUIRED).is_none(),
        "{REQUIRED} is set, and there is no Chromium: install one or name it in {NAMED}"
    );
    if found.is_none() {
        // Past the capture of the test harness: a test that did nothing must not look like one that passed.
        use std::io::Write;
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED: no Chromium, so the report was not looked at; install one or name it in {NAMED}"
        );
    }
    found
}

/// A page in a browser of its own.
pub struct Page {
    process: Child,
    socket: WebSocket<TcpStream>,
    session: String,
    last: u64,
    /// Everything the browser told, in order.
    pub events: Vec<Value>,
    _profile: tempfile::TempDir,
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Page {
    /// Opens a file and waits until it says that it is ready.
    pub fn open(browser: &Path, file: &Path, width: u32, height: u32) -> Self {
        let profile = tempfile::tempdir().unwrap();
        let process = Command::new(browser)
            .args([
                "--headless=new",
                "--no-sandbox",
                "--disable-dev-shm-usage",
                "--no-first-run",
                "--disable-background-networking",
                "--disable-component-update",
                "--disable-extensions",
                "--hide-scrollbars",
                "--use-gl=angle",
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                "--remote-debugging-port=0",
            ])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg(format!("--window-size={width},{height}"))
            .arg("about:blank")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let (port, path) = address(&profile.path().join("DevToolsActivePort"));
        let stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(120)))
            .unwrap();
        let url = format!("ws://127.0.0.1:{port}{path}");
        let (socket, _) = tungstenite::client(url, stream).unwrap();
        let mut page = Self {
            process,
            socket,
            session: String::new(),
            last: 0,
            events: Vec::new(),
            _profile: profile,
        };
        let target = page.call("Target.createTarget", &json!({"url": "about:blank"}));
        let attached = page.call(
            "Target.attachToTarget",
            &json!({"targetId": target["targetId"], "flatten": true}),
        );
        page.session = attached["sessionId"].as_str().map(str::to_owned).unwrap();
        for domain in ["Page", "Runtime", "Log", "Network"] {
            page.call(&format!("{domain}.enable"), &json!({}));
        }
        let metrics =
            json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": false});
        page.call("Emulation.setDeviceMetricsOverride", &metrics);
        let url = format!("file://{}", file.canonicalize().unwrap().display());
        page.call("Page.navigate", &json!({ "url": url }));
        page.wait("document.documentElement?.dataset.ready === 'yes'");
        page.settle();
        page
    }

    /// Calls a method of the browser and gives its result.
    pub fn call(&mut self, method: &str, parameters: &Value) -> Value {
        let answer = self.ask(method, parameters);
        assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
        answer["result"].clone()
    }

    /// Calls a method of the browser and gives its answer: a result or an error.
    fn ask(&mut self, method: &str, parameters: &Value) -> Value {
        self.last += 1;
        let mut message = json!({"id": self.last, "method": method, "params": parameters});
        if !self.session.is_empty() {
            message["sessionId"] = json!(self.session);
        }
        self.socket
            .send(Message::text(message.to_string()))
            .unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else {
                continue;
            };
            let answer: Value = serde_json::from_str(text.as_str()).unwrap();
            if answer["id"] == self.last {
                return answer;
            }
            if !answer["method"].is_null() {
                self.events.push(answer);
            }
        }
    }

    /// Value of an expression in the page.
    pub fn value(&mut self, expression: &str) -> Value {
        let parameters =
            json!({"expression": expression, "returnByValue": true, "awaitPromise": true});
        let result = self.call("Runtime.evaluate", &parameters);
        assert!(
            result["exceptionDetails"].is_null(),
            "{expression}: {result}"
        );
        result["result"]["value"].clone()
    }

    /// Waits until an expression is true.
    pub fn wait(&mut self, expression: &str) {
        let started = Instant::now();
        let parameters = json!({"expression": expression, "returnByValue": true});
        // While a page is being loaded there may be nothing to ask: that is no answer yet.
        while self.ask("Runtime.evaluate", &parameters)["result"]["result"]["value"] != true {
            let messages = self.complaints();
            assert!(
                started.elapsed() < Duration::from_secs(90) && messages.is_empty(),
                "waiting for {expression}: {messages:?}"
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Waits until what was asked to be drawn is drawn.
    pub fn settle(&mut self) {
        self.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(() => done(true)))))");
    }

    /// Errors and warnings of the page.
    pub fn complaints(&self) -> Vec<String> {
        let of = |event: &Value| match event["method"].as_str()? {
            "Runtime.exceptionThrown" => Some(event.to_string()),
            "Runtime.consoleAPICalled" if event["params"]["type"] != "log" => {
                Some(event.to_string())
            }
            "Log.entryAdded" => Some(event["params"]["entry"].to_string()),
            _ => None,
        };
        // SwiftShader is slow to read from, and says so whenever a picture is taken of it.
        let own = |text: &String| !text.contains("GPU stall due to ReadPixels");
        self.events.iter().filter_map(of).filter(own).collect()
    }

    /// What was asked of a file or a network.
    pub fn requests(&self) -> Vec<String> {
        let sent = |e: &&Value| e["method"] == "Network.requestWillBeSent";
        let url = |e: &Value| e["params"]["request"]["url"].as_str().unwrap().to_owned();
        let own = self.events.iter().filter(sent).map(url);
        own.filter(|url| !url.starts_with("data:")).collect()
    }

    /// A picture of the page as a PNG: what an element covers, or what is in the window.
    pub fn picture(&mut self, selector: Option<&str>) -> Vec<u8> {
        self.settle();
        let mut parameters = json!({"format": "png"});
        if let Some(selector) = selector {
            let clip = self.value(&format!(
                "(() => {{ const r = document.querySelector('{selector}').getBoundingClientRect(); \
                 return {{x: r.x + scrollX, y: r.y + scrollY, width: r.width, height: r.height, scale: 1}}; }})()"
            ));
            parameters["clip"] = clip;
            parameters["captureBeyondViewport"] = json!(true);
        }
        let answer = self.call("Page.captureScreenshot", &parameters);
        let text = answer["data"].as_str().unwrap();
        base64::engine::general_purpose::STANDARD
            .decode(text)
            .unwrap()
    }
}

/// Port and path of the debugging socket, from the file that the browser writes when it is up.
fn address(file: &Path) -> (u16, String) {
    let started = Instant::now();
    loop {
        let text = std::fs::read_to_string(file).unwrap_or_default();
        let mut lines = text.lines();
        if let (Some(port), Some(path)) = (lines.next(), lines.next()) {
            return (port.parse().unwrap(), path.to_owned());
        }
        assert!(
            started.elapsed() < Duration::from_secs(60),
            "the browser does not start"
        );
        std::thread::sleep(Duration::from_millis(50));
    }
}
