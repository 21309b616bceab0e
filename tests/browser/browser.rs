//! A headless chromium behind chromedriver, one at a time.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use fantoccini::wd::TimeoutConfiguration;
use fantoccini::{Client, ClientBuilder, Locator};
use hyper_util::client::legacy::connect::HttpConnector;
use serde_json::{Map, Value, json};
use tokio::sync::{Mutex, MutexGuard};

/// Software rendering, and no word to anybody outside.
const ARGUMENTS: [&str; 10] = [
    "--headless=new",
    "--no-sandbox",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--force-device-scale-factor=1",
];
/// Seconds after which what a test waits for is taken not to come.
const PATIENCE_SECONDS: u64 = 120;

/// Browsers take two hundred megabytes each.
static ONE_AT_A_TIME: Mutex<()> = Mutex::const_new(());

/// A browser with one page.
pub(crate) struct Browser {
    pub(crate) client: Client,
    driver: Child,
    _turn: MutexGuard<'static, ()>,
}

impl Browser {
    /// `None`, with the reason printed, where there is no chromedriver.
    pub(crate) async fn open() -> Option<Self> {
        Self::with(&["--window-size=800,560"], json!({})).await
    }

    /// A phone of 390 × 844 pixels, to be touched.
    pub(crate) async fn phone() -> Option<Self> {
        let metrics = json!({ "width": 390, "height": 844, "pixelRatio": 1, "touch": true });
        Self::with(&[], json!({ "mobileEmulation": { "deviceMetrics": metrics } })).await
    }

    /// With more arguments and options.
    pub(crate) async fn with(arguments: &[&str], options: Value) -> Option<Self> {
        let turn = ONE_AT_A_TIME.lock().await;
        let spawned =
            Command::new("chromedriver").arg("--port=0").stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let mut driver = match spawned {
            Ok(driver) => driver,
            Err(error) => {
                eprintln!("SKIPPED: no chromedriver ({error}); apt-get install chromium chromium-driver");
                return None;
            }
        };
        let port = port(&mut driver);
        let all: Vec<&str> = ARGUMENTS.iter().chain(arguments).copied().collect();
        let mut chrome = json!({ "args": all });
        chrome.as_object_mut().unwrap().extend(options.as_object().unwrap().clone());
        let capabilities = Map::from_iter([("goog:chromeOptions".to_owned(), chrome)]);
        let client = ClientBuilder::new(HttpConnector::new())
            .capabilities(capabilities)
            .connect(&format!("http://127.0.0.1:{port}"))
            .await
            .unwrap();
        let patience = TimeoutConfiguration::new(Some(Duration::from_secs(PATIENCE_SECONDS)), None, None);
        client.update_timeouts(patience).await.unwrap();
        Some(Self { client, driver, _turn: turn })
    }

    /// What a script returns.
    pub(crate) async fn run(&self, script: &str, arguments: Vec<Value>) -> Value {
        self.client.execute(script, arguments).await.unwrap()
    }

    /// The page's state as soon as `condition` holds of it, as an expression of `s`; not before it is drawn.
    pub(crate) async fn state(&self, condition: &str) -> Value {
        let script = format!(
            "const done = arguments[arguments.length - 1];\
             (function look() {{\
                 const s = window.chladni?.state;\
                 if (s && ({condition})) done(JSON.parse(JSON.stringify(s))); else requestAnimationFrame(look);\
             }})();"
        );
        match self.client.execute_async(&script, Vec::new()).await {
            Ok(state) => state,
            Err(error) => {
                let state = self.run("return JSON.stringify(window.chladni?.state)", Vec::new()).await;
                panic!("{condition} never came: {error}; the state is {state}")
            }
        }
    }

    /// The state once a job is shown with its first mode, neighbors and faces.
    pub(crate) async fn ready(&self) -> Value {
        let state = self.state("(s.phase === 'ready' && s.refined && !s.busy) || s.error").await;
        assert_eq!(state["error"], Value::Null);
        state
    }

    pub(crate) async fn click(&self, selector: &str) {
        self.client.find(Locator::Css(selector)).await.unwrap().click().await.unwrap();
    }

    pub(crate) async fn keys(&self, selector: &str, keys: &str) {
        self.client.find(Locator::Css(selector)).await.unwrap().send_keys(keys).await.unwrap();
    }

    pub(crate) async fn text(&self, selector: &str) -> String {
        self.client.find(Locator::Css(selector)).await.unwrap().text().await.unwrap()
    }

    /// Sets a control as a hand does: its value, then the event.
    pub(crate) async fn set(&self, id: &str, value: &str) {
        let script = "const control = document.getElementById(arguments[0]);\
                      control.value = arguments[1]; control.dispatchEvent(new Event('input', { bubbles: true }));";
        self.run(script, vec![id.into(), value.into()]).await;
    }

    /// Drops a file on the page, with a type that the browser guessed wrong, as it does for .obj.
    pub(crate) async fn drop_file(&self, name: &str, text: &str) {
        let script = "const data = new DataTransfer();\
                      data.items.add(new File([arguments[1]], arguments[0], { type: 'application/x-tgif' }));\
                      document.body.dispatchEvent(new DragEvent('drop', { dataTransfer: data, bubbles: true, cancelable: true }));";
        self.run(script, vec![name.into(), text.into()]).await;
    }

    /// Ends the browser; fails when the page did what its policy forbids.
    pub(crate) async fn close(mut self) {
        let reports = self.run("return window.chladni?.reports ?? []", Vec::new()).await;
        self.client.clone().close().await.unwrap();
        self.driver.kill().unwrap();
        self.driver.wait().unwrap();
        assert_eq!(reports, json!([]), "reports of the content security policy");
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // A test that failed: the driver takes its browser along.
        if self.driver.try_wait().is_ok_and(|status| status.is_none()) {
            let _ = Command::new("kill").arg(self.driver.id().to_string()).status();
            let _ = self.driver.wait();
        }
    }
}

/// The port that the driver says it listens on.
fn port(driver: &mut Child) -> u16 {
    let lines = BufReader::new(driver.stdout.take().unwrap()).lines();
    let port = lines.map_while(Result::ok).find_map(|line| {
        let (_, rest) = line.split_once("started successfully on port ")?;
        rest.trim_end_matches('.').parse().ok()
    });
    port.expect("chromedriver tells its port")
}
