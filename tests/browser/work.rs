//! What is done with modes: filters, feature points, distances.

use serde_json::{Value, json};

use crate::browser::Browser;
use crate::service::{Service, text, torus};

#[tokio::test]
async fn a_filter_in_the_browser_moves_points_to_where_the_service_puts_them() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let by = [1000.0, -2000.0, 50.0];
    let job = service.job("bases=24&operator=voronoi", text(&torus(900), by)).await;
    for (hash, query) in [
        ("filter=low-pass&to=10", "filter=low-pass&cutoff=10"),
        ("filter=high-pass&to=4", "filter=high-pass&cutoff=4"),
        ("filter=band-pass&from=1&to=9", "filter=band-pass&from=1&to=9"),
        ("filter=band-stop&from=3&to=12", "filter=band-stop&from=3&to=12"),
        ("filter=enhance&from=5&to=20&gain=3", "filter=enhance&from=5&to=20&gain=3"),
        ("filter=low-pass&to=12&outside=0.5", "filter=low-pass&cutoff=12&outside=0.5"),
    ] {
        browser.client.goto("about:blank").await.unwrap();
        browser.client.goto(&service.url(&format!("/#job={job}&{hash}"))).await.unwrap();
        browser.ready().await;
        browser.state("s.filtered && !s.busy").await;
        let filtered = service.json(&format!("/jobs/{job}/filtered?format=json&{query}")).await;
        for row in [0, 123, 456, 899] {
            let shown = browser.run("return window.chladni.position(arguments[0])", vec![json!(row)]).await;
            for axis in 0..3 {
                let error =
                    shown[axis].as_f64().unwrap() - filtered["coordinates"][row][axis].as_f64().unwrap();
                assert!(error.abs() < 2e-5, "{hash}, row {row}: {error}");
            }
        }
    }
    browser.close().await;
}

#[tokio::test]
async fn a_moving_handle_goes_on_from_where_the_filter_is_and_none_brings_the_scan_back() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let cloud = torus(900);
    let job = service.job("bases=24&operator=voronoi", text(&cloud, [0.0; 3])).await;
    browser.client.goto(&service.url(&format!("/#job={job}"))).await.unwrap();
    browser.ready().await;
    browser.set("filter", "low-pass").await;
    for edge in ["20", "6", "15"] {
        browser.set("to", edge).await;
    }
    browser.state("s.filter?.to === 15 && !s.busy").await;
    let filtered = service.json(&format!("/jobs/{job}/filtered?format=json&filter=low-pass&cutoff=15")).await;
    let shown = browser.run("return window.chladni.position(500)", vec![]).await;
    for axis in 0..3 {
        let error = shown[axis].as_f64().unwrap() - filtered["coordinates"][500][axis].as_f64().unwrap();
        assert!(error.abs() < 2e-6, "{error}");
    }
    let path = "return performance.getEntriesByType('resource').filter((entry) => entry.name.includes('/bases?')).length";
    assert!(browser.run(path, vec![]).await.as_u64().unwrap() <= 24, "each mode is fetched once");
    browser.set("filter", "").await;
    browser.state("!s.filtered && !s.busy").await;
    let shown = browser.run("return window.chladni.position(500)", vec![]).await;
    for axis in 0..3 {
        assert!((shown[axis].as_f64().unwrap() - cloud.point(500)[axis]).abs() < 1e-6);
    }
    browser.close().await;
}

#[tokio::test]
async fn feature_points_are_marked_by_rank_and_listed() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let job = service.job("bases=20&operator=voronoi", text(&torus(1500), [0.0; 3])).await;
    browser.client.goto(&service.url(&format!("/#job={job}&features=5"))).await.unwrap();
    browser.ready().await;
    let state = browser.state("s.features > 0").await;
    let features = service.json(&format!("/jobs/{job}/features?limit=5")).await;
    let found = features["features"].as_array().unwrap();
    assert_eq!(state["features"], found.len());
    browser.click(&format!("#feature-list li:nth-child({}) button", found.len())).await;
    let state = browser.state("s.picked?.facts").await;
    assert_eq!(state["picked"]["row"], found[found.len() - 1]["index"]);
    browser.close().await;
}

#[tokio::test]
async fn distances_from_the_picked_point_and_its_signature_are_those_of_the_service() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let job = service.job("bases=20&operator=voronoi", text(&torus(1500), [0.0; 3])).await;
    browser.client.goto(&service.url(&format!("/#job={job}&row=42"))).await.unwrap();
    browser.ready().await;
    browser.state("s.picked?.curve").await;
    browser.click("#distances").await;
    let state = browser.state("s.coloring.startsWith('biharmonic') && !s.busy && s.picked.value === 0").await;
    let answer = service.json(&format!("/jobs/{job}/distances?from=42")).await;
    let mut distances: Vec<f64> =
        answer["values"].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let most = distances[((distances.len() - 1) as f64 * 0.995).ceil() as usize];
    assert!(
        (state["high"].as_f64().unwrap() - most).abs() < 1e-6 * most,
        "the colors end at the 99.5th percentile"
    );
    let signature = service.json(&format!("/jobs/{job}/signatures?kind=hks")).await;
    for (scale, value) in state["picked"]["curve"].as_array().unwrap().iter().enumerate() {
        let expected = signature["values"][scale][42].as_f64().unwrap();
        assert!((value.as_f64().unwrap() - expected).abs() < 1e-6 * expected, "{scale}");
    }
    browser.close().await;
}
