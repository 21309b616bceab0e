//! What can be kept, and what is seen where the viewer cannot run.

use reqwest::StatusCode;
use reqwest::header::ACCEPT;
use serde_json::{Value, json};

use crate::browser::Browser;
use crate::look::MIDDLE;
use crate::service::{Service, text, torus};

/// What browsers send.
const BROWSER: &str = "text/html,application/xhtml+xml,application/xml;q=0.9,image/avif,image/webp,*/*;q=0.8";

#[tokio::test]
async fn browsers_get_the_page_and_everybody_else_the_links() {
    let service = Service::start().await;
    let ask = |accept: &'static str| service.http.get(service.url("/")).header(ACCEPT, accept).send();
    for accept in ["*/*", "application/json", "image/png"] {
        let answer = ask(accept).await.unwrap();
        assert_eq!(answer.headers()["content-type"], "application/json", "{accept}");
        assert!(answer.headers()["vary"].to_str().unwrap().to_ascii_lowercase().contains("accept"));
    }
    let page = ask(BROWSER).await.unwrap();
    let headers = page.headers().clone();
    assert_eq!(headers["content-type"], "text/html; charset=utf-8");
    assert_eq!(headers["x-content-type-options"], "nosniff");
    assert_eq!(headers["referrer-policy"], "no-referrer");
    let policy = headers["content-security-policy"].to_str().unwrap();
    for part in [
        "default-src 'none'",
        "script-src 'self'",
        "frame-ancestors 'none'",
        "require-trusted-types-for 'script'",
    ] {
        assert!(policy.contains(part), "{policy}");
    }
    let html = page.text().await.unwrap();
    let script = html.split("src=\"").nth(1).unwrap().split('"').next().unwrap();
    let file = service.http.get(service.url(script)).send().await.unwrap();
    assert_eq!(file.headers()["content-type"], "text/javascript");
    assert_eq!(file.headers()["cache-control"], "public, max-age=31536000, immutable");
    let other = service.http.get(service.url("/viewer/0123456789abcdef/main.js")).send().await.unwrap();
    assert_eq!(other.status(), StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn a_browser_without_scripts_gets_pictures_and_plain_links() {
    let service = Service::start().await;
    let job = service.job("bases=8&operator=voronoi", text(&torus(600), [0.0; 3])).await;
    let page = async |query: &str| {
        let answer =
            service.http.get(service.url(&format!("/{query}"))).header(ACCEPT, BROWSER).send().await.unwrap();
        answer.text().await.unwrap()
    };
    assert!(page("").await.contains(&format!("href=\"/?job={job}\"")), "the last jobs are listed");
    let shown = page(&format!("?job={job}&basis=3&azimuth=10&up=y")).await;
    let picture = shown.split("<img src=\"").nth(1).unwrap().split('"').next().unwrap().replace("&amp;", "&");
    assert_eq!(picture, format!("/jobs/{job}/bases/3/image.png?azimuth=10&elevation=20&up=y"));
    assert!(service.bytes(&picture).await.starts_with(b"\x89PNG"));
    assert!(
        shown.contains(&format!(
            "/?job={job}&amp;basis=4&amp;azimuth=10&amp;elevation=20&amp;up=y\">next mode"
        ))
    );
    assert!(shown.contains("azimuth=40&amp;elevation=20&amp;up=y\">turn right"));
}

#[tokio::test]
async fn without_webgl_the_pictures_of_the_service_are_shown_with_the_same_controls() {
    let Some(browser) = Browser::with(&["--disable-3d-apis", "--window-size=800,560"], json!({})).await
    else {
        return;
    };
    let service = Service::start().await;
    let job = service.job("bases=8&operator=voronoi", text(&torus(600), [0.0; 3])).await;
    browser.client.goto(&service.url(&format!("/#job={job}&basis=3"))).await.unwrap();
    let loaded = "document.querySelector('#pictures img')?.naturalWidth === 800";
    browser.state(&format!("s.phase === 'ready' && {loaded}")).await;
    browser.run("[...document.querySelectorAll('#pictures a')].find((link) => link.textContent === 'next mode').click()", vec![]).await;
    browser
        .state(&format!("document.querySelector('#pictures img').alt.endsWith('mode 4') && {loaded}"))
        .await;
    browser.close().await;
}

#[tokio::test]
async fn a_view_is_kept_as_one_page_that_opens_from_disk() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let job = service.job("bases=8&operator=voronoi", text(&torus(900), [0.0; 3])).await;
    browser.client.goto(&service.url(&format!("/#job={job}&basis=3&features=2"))).await.unwrap();
    browser.ready().await;
    let script = "const done = arguments[0]; window.chladni.page().then(done)";
    let page = browser.client.execute_async(script, vec![]).await.unwrap();
    let folder = tempfile::TempDir::new().unwrap();
    let file = folder.path().join("view.html");
    std::fs::write(&file, page.as_str().unwrap()).unwrap();
    service.app.shutdown().await;
    browser.client.goto(&format!("file://{}", file.display())).await.unwrap();
    let look = "const done = arguments[0]; (function look() { if (window.chladni?.drawn) done(window.chladni.drawn); else requestAnimationFrame(look); })()";
    assert_eq!(browser.client.execute_async(look, vec![]).await.unwrap(), 900);
    assert!(browser.text("#caption").await.contains("mode 3, λ = "));
    // The picture has the cloud in it: not one color alone.
    let colors = "const sheet = document.createElement('canvas'); const canvas = document.getElementById('canvas');\
        [sheet.width, sheet.height] = [canvas.width, canvas.height]; window.dispatchEvent(new Event('resize'));\
        const pen = sheet.getContext('2d'); pen.drawImage(canvas, 0, 0);\
        return new Set(new Uint32Array(pen.getImageData(0, 0, sheet.width, sheet.height).data.buffer)).size";
    assert!(browser.run(colors, vec![]).await.as_u64().unwrap() > 200);
    browser.run("window.chladni.reports = []", vec![]).await;
    browser.close().await;
}

#[tokio::test]
async fn a_lost_context_comes_back_with_the_same_picture() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let job = service.job("bases=8&operator=voronoi", text(&torus(900), [0.0; 3])).await;
    browser.client.goto(&service.url(&format!("/#job={job}&basis=3&azimuth=-20&zoom=1.5"))).await.unwrap();
    browser.ready().await;
    browser.run(MIDDLE, vec![]).await;
    let before = browser.state("s.picked?.facts").await;
    browser.run("window.lose = window.chladni.context().getExtension('WEBGL_lose_context'); window.lose.loseContext()", vec![]).await;
    browser.state("window.chladni.context().isContextLost()").await;
    let frames = browser.run("return window.chladni.state.frames", vec![]).await;
    browser.run("window.lose.restoreContext()", vec![]).await;
    browser.state(&format!("s.frames > {frames} && s.drawn === 900")).await;
    browser.run("document.getElementById('unpick').click()", vec![]).await;
    browser.state("!s.picked").await;
    browser.run(MIDDLE, vec![]).await;
    let after = browser.state("s.picked?.facts").await;
    assert_eq!(
        (&after["picked"]["row"], &after["picked"]["color"]),
        (&before["picked"]["row"], &before["picked"]["color"])
    );
    browser.close().await;
}

#[tokio::test]
async fn the_commands_of_a_view_give_its_numbers_and_its_picture() {
    let Some(browser) = Browser::open().await else { return };
    let service = Service::start().await;
    let job = service.job("bases=8&operator=voronoi", text(&torus(600), [0.0; 3])).await;
    for hash in [
        "basis=3",
        "color=hks",
        "color=wks",
        "color=distance&row=3",
        "color=plain",
        "features=2",
        "filter=band-stop&from=2&to=4",
    ] {
        browser.client.goto("about:blank").await.unwrap();
        browser.client.goto(&service.url(&format!("/#job={job}&{hash}"))).await.unwrap();
        browser.ready().await;
        let commands = browser.run("return window.chladni.curl()", vec![]).await;
        let commands: Vec<&str> = commands.as_str().unwrap().lines().collect();
        assert_eq!(commands.len(), 2);
        for command in commands {
            let address = command.split('\'').nth(1).unwrap();
            let answer = service.http.get(address).send().await.unwrap();
            assert_eq!(answer.status(), StatusCode::OK, "{command}");
        }
    }
    assert_eq!(browser.run("return window.chladni.state.error", vec![]).await, Value::Null);
    browser.close().await;
}

#[tokio::test]
async fn pictures_have_a_color_bar_on_demand_and_open_in_the_browser() {
    let service = Service::start().await;
    let job = service.job("bases=6&operator=voronoi", text(&torus(600), [0.0; 3])).await;
    let path = format!("/jobs/{job}/bases/3/image.png?width=400&height=300");
    let (plain, with_bar) = (service.bytes(&path).await, service.bytes(&format!("{path}&legend=true")).await);
    assert_ne!(plain, with_bar);
    for path in [path, format!("/jobs/{job}/spectrum?format=svg"), format!("/jobs/{job}/spectrum?format=csv")]
    {
        let answer = service.http.get(service.url(&path)).send().await.unwrap();
        let disposition = answer.headers()["content-disposition"].to_str().unwrap();
        assert!(disposition.starts_with("inline; filename=\""), "{path}: {disposition}");
    }
    let array = service.http.get(service.url(&format!("/jobs/{job}/bases?format=npy"))).send().await.unwrap();
    assert!(array.headers()["content-disposition"].to_str().unwrap().starts_with("attachment"));
}
