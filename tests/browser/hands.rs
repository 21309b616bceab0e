//! Reach: keyboard alone, touch, narrow screens, assistive technology.

use std::process::Command;

use fantoccini::Locator;
use fantoccini::actions::{InputSource, PointerAction, TouchActions};
use serde_json::{Value, json};

use crate::browser::Browser;
use crate::service::{Service, text, torus};

const RIGHT: &str = "\u{e014}";
const TAB: &str = "\u{e004}";

async fn shown(browser: &Browser, more: &str) -> Service {
    let service = Service::start().await;
    let job = service.job("bases=12&operator=voronoi", text(&torus(900), [0.0; 3])).await;
    browser.client.goto(&service.url(&format!("/#job={job}{more}"))).await.unwrap();
    browser.ready().await;
    service
}

#[tokio::test]
async fn the_keyboard_alone_turns_zooms_changes_modes_and_reaches_every_control() {
    let Some(browser) = Browser::open().await else { return };
    let _service = shown(&browser, "").await;
    browser.keys("#canvas", &RIGHT.repeat(3)).await;
    browser.keys("#canvas", "++").await;
    browser.keys("#canvas", "..").await;
    let state = browser.state("s.mode === 3 && !s.busy").await;
    assert_eq!(state["error"], Value::Null);
    let view = browser.run("return window.chladni.view", vec![]).await;
    assert_eq!(view["azimuth"], -78);
    assert!((view["zoom"].as_f64().unwrap() - 1.15 * 1.15).abs() < 1e-9);
    browser.keys("#mode", RIGHT).await;
    browser.state("s.mode === 4 && !s.busy").await;

    let script = "return [...document.querySelectorAll('button, select, input, a, canvas[tabindex], summary')]\
        .filter((control) => control.checkVisibility() && !control.closest('dialog')).length";
    let controls = browser.run(script, vec![]).await.as_u64().unwrap();
    browser.run("document.activeElement.blur()", vec![]).await;
    browser.run("window.reached = new Set(); document.addEventListener('focusin', (event) => window.reached.add(event.target))", vec![]).await;
    for _ in 0..2 * controls {
        let focused = browser.client.active_element().await.unwrap();
        focused.send_keys(TAB).await.unwrap();
    }
    let reached = browser.run("return window.reached.size", vec![]).await.as_u64().unwrap();
    assert!(reached >= controls, "{reached} of {controls} controls are reached by Tab");
    browser.close().await;
}

#[tokio::test]
async fn a_finger_turns_and_a_tap_picks_on_a_phone_without_sideways_scrolling() {
    let Some(browser) = Browser::phone().await else { return };
    let _service = shown(&browser, "&azimuth=-20&zoom=1.5").await;
    let widths =
        browser.run("return [document.documentElement.scrollWidth, window.innerWidth]", vec![]).await;
    assert_eq!(widths[0], widths[1]);
    let canvas = browser.client.find(Locator::Css("#canvas")).await.unwrap();
    let at = |x, y| PointerAction::MoveToElement { element: canvas.clone(), duration: None, x, y };
    let finger = || TouchActions::new("finger".to_owned());
    let drag = finger().then(at(0.0, 0.0)).then(PointerAction::Down { button: 0 });
    let drag = drag.then(at(30.0, 0.0)).then(at(60.0, 10.0)).then(PointerAction::Up { button: 0 });
    browser.client.perform_actions(drag).await.unwrap();
    let view = browser.run("return window.chladni.view", vec![]).await;
    assert!(
        view["azimuth"].as_f64().unwrap() < -35.0 && view["elevation"].as_f64().unwrap() > 20.0,
        "{view}"
    );
    let back = finger().then(at(60.0, 10.0)).then(PointerAction::Down { button: 0 });
    let back = back.then(at(30.0, 0.0)).then(at(0.0, 0.0)).then(PointerAction::Up { button: 0 });
    browser.client.perform_actions(back).await.unwrap();
    let tap = finger()
        .then(at(0.0, 0.0))
        .then(PointerAction::Down { button: 0 })
        .then(PointerAction::Up { button: 0 });
    browser.client.perform_actions(tap).await.unwrap();
    let state = browser.state("s.picked?.facts").await;
    assert!(state["picked"]["row"].as_u64().unwrap() < 900);
    browser.close().await;
}

#[tokio::test]
async fn changes_are_said_to_those_who_listen() {
    let Some(browser) = Browser::open().await else { return };
    let _service = shown(&browser, "").await;
    browser.set("mode", "6").await;
    browser.state("s.mode === 6 && !s.busy").await;
    let said = browser
        .run("const said = document.getElementById('said'); return [said.ariaLive, said.textContent]", vec![])
        .await;
    assert_eq!(said[0], "polite");
    assert!(said[1].as_str().unwrap().starts_with("mode 6, λ = "), "{said}");
    browser.close().await;
}

#[tokio::test]
async fn axe_finds_no_violation_in_light_and_in_dark() {
    let Some(browser) = Browser::open().await else { return };
    let folder = tempfile::TempDir::new().unwrap();
    let Some(axe) = axe(folder.path()) else {
        browser.close().await;
        return;
    };
    let service = shown(&browser, "&features=3&row=7&filter=enhance&from=2&to=6").await;
    browser.state("s.picked?.curve && s.filtered").await;
    for step in ["light", "dark", "welcome"] {
        match step {
            "dark" => browser.click("#theme").await,
            "welcome" => {
                browser.client.goto("about:blank").await.unwrap();
                browser.client.goto(&service.url("/")).await.unwrap();
                browser.state("s.phase === 'empty' && document.getElementById('formats').textContent").await;
                browser.click("#welcome [data-open]").await;
            }
            _ => {}
        }
        browser.run(&axe, vec![]).await;
        let script = "const done = arguments[0]; axe.run().then((found) => done(found.violations\
            .map((one) => `${one.id}: ${one.nodes.map((node) => node.html + ' ' + node.failureSummary).join(' | ')}`)));";
        let violations = browser.client.execute_async(script, vec![]).await.unwrap();
        assert_eq!(violations, json!([]), "{step}");
    }
    browser.close().await;
}

/// The source of axe-core from npm; `None`, with the reason printed, where it cannot be had.
fn axe(folder: &std::path::Path) -> Option<String> {
    let packed =
        Command::new("npm").args(["pack", "--silent", "axe-core@4.10.3"]).current_dir(folder).output();
    let archive = match packed {
        Ok(output) if output.status.success() => String::from_utf8_lossy(&output.stdout).trim().to_owned(),
        Ok(output) => return skipped(&String::from_utf8_lossy(&output.stderr)),
        Err(error) => return skipped(&error.to_string()),
    };
    let unpacked =
        Command::new("tar").args(["-xzf", &archive, "package/axe.min.js"]).current_dir(folder).status();
    if !unpacked.is_ok_and(|status| status.success()) {
        return skipped("the package cannot be unpacked");
    }
    std::fs::read_to_string(folder.join("package/axe.min.js")).ok()
}

fn skipped(reason: &str) -> Option<String> {
    eprintln!("SKIPPED: axe-core cannot be had from npm ({})", reason.trim());
    None
}
