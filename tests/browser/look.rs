//! From a dropped scan to its modes, and what they look like.

use std::fmt::Write as _;

use chladni::cloud::reader::Format;
use chladni::cloud::shapes::{SampleRequest, Shape, sample};
use chladni::cloud::writer::write;
use chladni::picture::{ABSENT, Map, srgb};
use serde_json::{Value, json};

use crate::browser::Browser;
use crate::service::{Service, text, torus};

/// A click on the middle of the canvas.
pub(crate) const MIDDLE: &str = "const canvas = document.getElementById('canvas'); const box = canvas.getBoundingClientRect();\
    const at = { clientX: box.x + box.width / 2, clientY: box.y + box.height / 2, pointerId: 1, button: 0, bubbles: true };\
    canvas.setPointerCapture = () => {};\
    for (const kind of ['pointerdown', 'pointerup']) canvas.dispatchEvent(new PointerEvent(kind, at));";

#[tokio::test]
async fn a_dropped_scan_is_seen_analyzed_turned_through_picked_and_brought_back_by_its_address() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    browser.client.goto(&service.url("/")).await.unwrap();
    browser.state("s.phase === 'empty'").await;
    browser.click("#welcome [data-open]").await;
    browser.state("document.getElementById('parameter-bases')").await;
    browser.set("parameter-bases", "20").await;
    browser.click("#open [data-close]").await;
    browser.drop_file("two holes.xyz", &text(&torus(2000), [0.0; 3])).await;
    let state = browser.ready().await;
    assert_eq!(
        (&state["points"], &state["modes"], &state["mode"], &state["drawn"]),
        (&json!(2000), &json!(20), &json!(1), &json!(2000))
    );
    assert!(browser.text("#title").await.starts_with("two holes.xyz"));

    browser.set("mode", "7").await;
    let state = browser.state("s.mode === 7 && !s.busy").await;
    let job = state["job"]["id"].as_str().unwrap().to_owned();
    let spectrum = service.json(&format!("/jobs/{job}/spectrum")).await;
    assert_eq!(state["eigenvalue"], spectrum["eigenvalues"][7]);
    browser.set("up", "y").await;
    // The middle of the torus is inside of it: whatever the direction, there is surface before it.
    browser.run("location.hash = `${window.chladni.fragment()}&x=-0.05&azimuth=-20&zoom=1.5`", vec![]).await;
    browser.state("window.chladni.view.x === -0.05").await;
    browser.run(MIDDLE, vec![]).await;
    let before = browser.state("s.picked?.curve && !s.busy").await;

    let address = browser.run("return window.chladni.fragment()", vec![]).await;
    browser.client.goto("about:blank").await.unwrap();
    browser.client.goto(&service.url(&format!("/#{}", address.as_str().unwrap()))).await.unwrap();
    browser.ready().await;
    let after = browser.state("s.picked?.curve && !s.busy").await;
    for part in ["points", "modes", "mode", "eigenvalue", "low", "high", "coloring", "drawn"] {
        assert_eq!(after[part], before[part], "{part}");
    }
    for part in ["row", "facts", "value", "curve"] {
        assert_eq!(after["picked"][part], before["picked"][part], "{part}");
    }
    assert_eq!(browser.run("return window.chladni.fragment()", vec![]).await, address);
    if let Ok(folder) = std::env::var("CHLADNI_SCREENSHOTS") {
        std::fs::write(format!("{folder}/torus.png"), browser.client.screenshot().await.unwrap()).unwrap();
    }
    browser.close().await;
}

#[tokio::test]
async fn a_picked_pixel_has_the_row_the_value_and_the_color_of_the_service() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let sphere = sample(&SampleRequest::new(Shape::Ellipsoid, 4000)).unwrap();
    let job = service.job("bases=10&operator=voronoi", text(&sphere, [0.0; 3])).await;
    for (hash, kind, path) in [
        ("color=basis&basis=3", Map::diverging(), format!("/jobs/{job}/bases?first=3&count=1")),
        ("color=hks&scale=4", Map::sequential(), format!("/jobs/{job}/signatures?kind=hks")),
    ] {
        browser.client.goto("about:blank").await.unwrap();
        browser.client.goto(&service.url(&format!("/#job={job}&{hash}"))).await.unwrap();
        browser.ready().await;
        browser.run(MIDDLE, vec![]).await;
        let state = browser.state("s.picked?.facts && !s.busy").await;
        let picked = &state["picked"];
        let row = picked["row"].as_u64().unwrap() as usize;
        let answer = service.json(&path).await;
        let column = if path.contains("bases") { &answer["bases"][0] } else { &answer["values"][4] };
        let value = column[row].as_f64().unwrap();
        assert!((picked["value"].as_f64().unwrap() - value).abs() < 1e-6 * value.abs().max(1.0), "{picked}");
        let [low, high] = ["low", "high"].map(|end| state[end].as_f64().unwrap());
        let share = (picked["value"].as_f64().unwrap() - low) / (high - low);
        let near: Vec<Value> =
            [-0.5, 0.0, 0.5].iter().map(|step| json!(srgb(kind.at(share + step / 255.0)))).collect();
        assert!(near.contains(&picked["color"]), "{}: {near:?}", picked["color"]);
        // The camera looks from azimuth −60°, elevation 20°: the point in the middle lies on that side.
        let facts = &picked["facts"];
        let [x, y, z] = ["x", "y", "z"].map(|name| facts[name].as_f64().unwrap());
        let point = sphere.point(row);
        assert_eq!([x, y, z].map(f64::to_bits), [point[0], point[1], point[2]].map(f64::to_bits));
        assert!(0.5 * x - 0.87 * y + 0.36 * z > 0.3, "{x} {y} {z}");
    }
    browser.close().await;
}

#[tokio::test]
async fn rows_without_a_result_are_gray_and_said_to_have_no_value() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    // A crumb of four points in the line of sight, too small to be analyzed, and rows that are not finite.
    let mut file = text(&sample(&SampleRequest::new(Shape::Sphere, 1500)).unwrap(), [0.0; 3]);
    for [x, y, z] in [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]] {
        let at = [1.0 + x, -1.7 + y, 0.75 + z];
        writeln!(file, "{} {} {}", at[0], at[1], at[2]).unwrap();
    }
    file += "nan nan nan\n";
    let job = service.job("bases=6&operator=voronoi&nonfinite=drop", file).await;
    browser.client.goto(&service.url(&format!("/#job={job}&row=1501"))).await.unwrap();
    let state = browser.ready().await;
    assert_eq!(state["points"], 1505);
    assert_eq!(browser.state("s.picked?.facts").await["picked"]["value"], Value::Null);
    assert!(
        !browser
            .run("return document.getElementById('legend-absent').hidden", vec![])
            .await
            .as_bool()
            .unwrap()
    );
    // Somewhere on the canvas the crumb is seen.
    let script = "const canvas = document.getElementById('canvas'); const box = canvas.getBoundingClientRect(); const done = arguments[0];\
        canvas.setPointerCapture = () => {};\
        for (let y = -60; y < 60; y += 6) for (let x = -60; x < 60; x += 6) {\
          const at = { clientX: box.x + box.width / 2 + x, clientY: box.y + box.height / 2 + y, pointerId: 1, button: 0 };\
          for (const kind of ['pointerdown', 'pointerup']) canvas.dispatchEvent(new PointerEvent(kind, at));\
          const { picked } = window.chladni.state;\
          if (picked && picked.row >= 1500) { done(picked.color); return; }\
        } done(null);";
    let color = browser.client.execute_async(script, vec![]).await.unwrap();
    assert_eq!(color, json!(srgb(ABSENT)));
    browser.close().await;
}

#[tokio::test]
async fn a_georeferenced_cloud_is_shown_to_the_millimeter() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let by = [512_345.0, 5_403_210.0, 312.0];
    let cloud = torus(1200);
    let job = service.job("bases=8&operator=voronoi", text(&cloud, by)).await;
    browser.client.goto(&service.url(&format!("/#job={job}&row=77"))).await.unwrap();
    browser.ready().await;
    browser.state("s.picked?.facts").await;
    let shown = browser.run("return window.chladni.position(77)", vec![]).await;
    for axis in 0..3 {
        let error = shown[axis].as_f64().unwrap() - cloud.point(77)[axis] - by[axis];
        assert!(error.abs() < 1e-6, "{axis}: {error}");
    }
    browser.close().await;
}

#[tokio::test]
async fn triangles_are_drawn_where_the_scan_has_faces() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let height = |i: u32, j: u32| (f64::from(i) * 0.4).sin() * (f64::from(j) * 0.3).cos();
    let mut mesh = String::new();
    for i in 0..30 {
        for j in 0..30 {
            writeln!(mesh, "v {i} {j} {}", height(i, j)).unwrap();
        }
    }
    for i in 0..29 {
        for j in 0..29 {
            let corner = 30 * i + j + 1;
            writeln!(mesh, "f {corner} {} {} {}", corner + 1, corner + 31, corner + 30).unwrap();
        }
    }
    let job = service.job("bases=6&operator=cotangent&format=obj", mesh).await;
    browser.client.goto(&service.url(&format!("/#job={job}"))).await.unwrap();
    assert_eq!(browser.ready().await["faces"], 2 * 29 * 29);
    browser.close().await;
}

#[tokio::test]
async fn names_out_of_files_stay_text() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let name = "<img/src=x/onerror=window.harmed=1>";
    let mut cloud = torus(600);
    let values = (0..600).map(f64::from).collect();
    let field = chladni::cloud::ScalarField {
        name: name.to_owned(),
        kind: chladni::cloud::ScalarType::Float64,
        values,
    };
    cloud = cloud.with_fields(vec![field]).unwrap();
    let mut file = Vec::new();
    write(&cloud, Format::Ply, &mut file).unwrap();
    let job = service.job("bases=5&operator=voronoi", file).await;
    browser.client.goto(&service.url(&format!("/#job={job}&color=field&row=5"))).await.unwrap();
    browser.ready().await;
    let state = browser.state("s.picked?.facts").await;
    assert_eq!((&state["coloring"], &state["picked"]["facts"][name]), (&json!(name), &json!(5)));
    assert_eq!(browser.text("#legend-title").await, name);
    assert_eq!(
        browser.run("return [window.harmed ?? null, document.querySelectorAll('img').length]", vec![]).await,
        json!([null, 0])
    );
    browser.close().await;
}
