//! Jobs on their way: keys, progress, failures, many modes.

use std::sync::Arc;

use chladni::analysis::AnalysisError;
use chladni::jobs::{Analyze, default_analysis};
use chladni::progress::Phase;
use serde_json::{Value, json};

use crate::browser::Browser;
use crate::service::{Service, text, torus};

const KEY: &str = "0123456789abcdef0123456789abcdef";

#[tokio::test]
async fn a_key_is_asked_for_once_kept_in_the_tab_and_never_part_of_an_address() {
    let Some(browser) = Browser::open().await else { return };
    let keys = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(keys.path(), format!("someone {KEY}\n")).unwrap();
    let service =
        Service::with(|settings| settings.api_keys = Some(keys.path().to_owned()), default_analysis()).await;
    browser.client.goto(&service.url("/")).await.unwrap();
    browser.state("s.key").await;
    browser.keys("#key-text", "wrong").await;
    browser.click("#key-form button[type=submit]").await;
    browser.state("s.key && document.getElementById('key-reason').textContent").await;
    browser.keys("#key-text", KEY).await;
    browser.click("#key-form button[type=submit]").await;
    browser.state("s.phase === 'empty' && !s.key").await;
    browser.drop_file("torus.xyz", &text(&torus(500), [0.0; 3])).await;
    browser.ready().await;
    browser.client.refresh().await.unwrap();
    let state = browser.ready().await;
    assert_eq!(state["points"], 500);
    let script = "return performance.getEntriesByType('resource').map((entry) => entry.name).concat(location.href).join('\\n')";
    let addresses = browser.run(script, vec![]).await;
    assert!(!addresses.as_str().unwrap().contains(KEY), "{addresses}");
    let command = browser.run("return window.chladni.curl()", vec![]).await;
    assert!(
        command.as_str().unwrap().contains("Bearer $CHLADNI_KEY") && !command.as_str().unwrap().contains(KEY)
    );
    browser.close().await;
}

#[tokio::test]
async fn a_job_that_fails_tells_why_and_the_cloud_stays_on_the_stage() {
    let Some(browser) = Browser::open().await else { return };
    let failing: Arc<Analyze> = Arc::new(|_, _, _, progress| {
        progress.enter(Phase::Cells)?;
        Err(AnalysisError::Cloud("the scan is made of glass; spray it with chalk".to_owned()))
    });
    let service = Service::with(|_| {}, failing).await;
    browser.client.goto(&service.url("/")).await.unwrap();
    browser.state("s.phase === 'empty'").await;
    browser.drop_file("torus.xyz", &text(&torus(500), [0.0; 3])).await;
    let state = browser.state("s.phase === 'failed'").await;
    let job = service.json(&format!("/jobs/{}", state["job"]["id"].as_str().unwrap())).await;
    assert_eq!(state["error"], job["error"]["detail"]);
    assert_eq!(browser.text("#message p").await, job["error"]["detail"]);
    assert_eq!((&state["points"], &state["drawn"]), (&json!(500), &json!(500)));
    browser.close().await;
}

#[tokio::test]
async fn a_refused_file_tells_why() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    browser.client.goto(&service.url("/")).await.unwrap();
    browser.state("s.phase === 'empty'").await;
    browser.drop_file("broken.ply", "ply\nformat ascii 1.0\nelement vertex 9\n").await;
    let state = browser.state("s.phase === 'failed'").await;
    assert!(state["error"].as_str().unwrap().contains("PLY"), "{state}");
    browser.close().await;
}

#[tokio::test]
async fn a_running_job_shows_its_cloud_and_its_phase_and_can_be_canceled() {
    let Some(browser) = Browser::open().await else { return };
    let endless: Arc<Analyze> = Arc::new(|_, _, _, progress| {
        progress.enter(Phase::Eigenpairs)?;
        loop {
            progress.advance(0.5)?;
            std::thread::yield_now();
        }
    });
    let service = Service::with(|_| {}, endless).await;
    browser.client.goto(&service.url("/")).await.unwrap();
    browser.state("s.phase === 'empty'").await;
    browser.drop_file("torus.xyz", &text(&torus(500), [0.0; 3])).await;
    let state = browser.state("s.phase === 'running' && s.message === 'eigenpairs' && s.drawn").await;
    assert!(state["job"]["progress"].as_f64().unwrap() > 0.0);
    assert_eq!(browser.text("#progress-phase").await, "eigenpairs");
    browser.click("#cancel").await;
    browser.state("s.phase === 'canceled'").await;
    browser.close().await;
}

#[tokio::test]
async fn a_job_that_is_deleted_while_it_is_shown_is_told_and_what_is_seen_stays() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let job = service.job("bases=12&operator=voronoi", text(&torus(800), [0.0; 3])).await;
    browser.client.goto(&service.url(&format!("/#job={job}"))).await.unwrap();
    browser.ready().await;
    service
        .http
        .delete(service.url(&format!("/jobs/{job}")))
        .send()
        .await
        .unwrap()
        .error_for_status()
        .unwrap();
    browser.set("mode", "9").await;
    let state =
        browser.state("s.phase === 'gone' && document.querySelector('#message p')?.textContent").await;
    assert_eq!((&state["drawn"], &state["mode"]), (&json!(800), &json!(1)));
    browser.close().await;
}

#[tokio::test]
async fn a_thousand_modes_are_turned_through() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let job = service.job("bases=1000&operator=graph", text(&torus(1100), [0.0; 3])).await;
    browser.client.goto(&service.url(&format!("/#job={job}&basis=990"))).await.unwrap();
    let state = browser.ready().await;
    assert_eq!((&state["modes"], &state["mode"]), (&json!(1000), &json!(990)));
    for _ in 0..8 {
        browser.click("#after").await;
    }
    browser.state("s.mode === 998 && !s.busy").await;
    browser.click("#after").await;
    browser.click("#after").await;
    let state = browser.state("s.mode === 0 && !s.busy").await;
    assert_eq!(state["error"], Value::Null, "after the last mode comes the first");
    browser.close().await;
}
