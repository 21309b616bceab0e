//! The figures of `docs/viewer.md`, measured: `CHLADNI_FIGURES="igea.ply bumpy.ply" cargo test --release --test browser
//! figures -- --ignored --nocapture`.

use std::path::Path;
use std::time::Duration;

use fantoccini::wd::TimeoutConfiguration;
use serde_json::Value;

use crate::browser::Browser;
use crate::service::Service;

/// Milliseconds from moving the slider to the picture of the mode, for modes that were not seen before and then for the same
/// again: medians.
const SLIDER: &str = "const done = arguments[arguments.length - 1]; const state = window.chladni.state;\
    const slider = document.getElementById('mode');\
    const turn = (mode) => new Promise((resolve) => {\
        const began = performance.now(); const before = state.frames;\
        slider.value = mode; slider.dispatchEvent(new Event('input', { bubbles: true }));\
        const look = () => state.mode === mode && !state.busy && state.frames > before\
            ? resolve(performance.now() - began) : requestAnimationFrame(look);\
        look();\
    });\
    const middle = (times) => times.sort((a, b) => a - b)[times.length >> 1];\
    (async () => {\
        const modes = [3, 5, 7, 9, 11, 13, 15]; const first = []; const again = [];\
        for (const mode of modes) first.push(await turn(mode));\
        for (const mode of modes) again.push(await turn(mode));\
        done([middle(first), middle(again)]);\
    })();";

#[tokio::test(flavor = "multi_thread")]
#[ignore = "measures the scans that CHLADNI_FIGURES names"]
async fn times_of_the_viewer() {
    let scans = std::env::var("CHLADNI_FIGURES").expect("CHLADNI_FIGURES names scans");
    for scan in scans.split_whitespace() {
        let Some(browser) = Browser::with(&["--window-size=1280,800"], serde_json::json!({})).await else {
            return;
        };
        let service = Service::start().await;
        browser.client.goto(&service.url("/")).await.unwrap();
        browser.state("s.phase === 'empty'").await;
        browser.click("#welcome [data-open]").await;
        browser.state("document.getElementById('parameter-bases')").await;
        browser.set("parameter-bases", "20").await;
        browser.set("parameter-operator", "voronoi").await;
        let path = Path::new(scan).canonicalize().unwrap();
        browser.keys("input[type=file]", path.to_str().unwrap()).await;
        // a scan of a million points is analyzed, and drawn without a graphics card, longer than a page is waited for
        let patience = TimeoutConfiguration::new(Some(Duration::from_mins(15)), None, None);
        browser.client.update_timeouts(patience).await.unwrap();
        let state = browser.state("s.phase === 'ready' || s.error").await;
        assert_eq!(state["error"], Value::Null);
        let measured = browser.run("return window.chladni.measure(9)", vec![]).await;
        let moving = browser.run("return window.chladni.measure(9, 2e6)", vec![]).await;
        let slider = browser.client.execute_async(SLIDER, vec![]).await.unwrap();
        let milliseconds = |value: &Value| format!("{:.0} ms", value.as_f64().unwrap());
        println!(
            "{scan}: {} points; first frame {}, first mode {}; frame {} ({} while moving); slider {}, again {}",
            state["points"],
            milliseconds(&state["times"]["firstFrame"]),
            milliseconds(&state["times"]["firstMode"]),
            milliseconds(&measured),
            milliseconds(&moving),
            milliseconds(&slider[0]),
            milliseconds(&slider[1]),
        );
        browser.close().await;
    }
}
