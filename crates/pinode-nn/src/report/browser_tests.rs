//! The report in a real browser: headless Chromium, wide and narrow, light and dark.
//!
//! A copy of the report carries a script that looks at the finished page and tells the page around it what it saw; the browser prints that.
//! Where PINODE_BROWSER names a browser the test needs it; else it takes one from the PATH, and is skipped, loudly, without one.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use super::sheet::{Curve, Grid, GridRow, Section, Sheet, Style};
use super::tests::{curves, diagnosis, unexplained};
use super::*;
use crate::diagnose::verdict::Verdict;

/// Before the page's own scripts: what they complain of is kept.
const LISTEN: &str = r#"<script>
window.__said = [];
window.addEventListener("error", e => window.__said.push("error: " + e.message));
window.addEventListener("unhandledrejection", e => window.__said.push("rejection: " + e.reason));
window.addEventListener("securitypolicyviolation", e => window.__said.push("policy: " + e.blockedURI));
for (const level of ["error", "warn"]) {
  const own = console[level];
  console[level] = (...all) => { window.__said.push(level + ": " + all.join(" ")); own.apply(console, all); };
}
</script>"#;

/// After them: the figures with the sizes of what is drawn, overflow, colours.
const LOOK: &str = r#"<script>
window.addEventListener("load", () => setTimeout(() => {
  const figures = [...document.querySelectorAll("figure > .plot")].map(plot => {
    const box = plot.getBoundingClientRect();
    const svg = plot.querySelector("svg.main-svg");
    const drawn = plot.querySelector(".scatterlayer path, .scatterlayer .point, .barlayer path, .heatmaplayer image");
    const at = svg ? svg.getBoundingClientRect() : { width: 0, height: 0, right: 0 };
    return { width: at.width, height: at.height, beyond: at.right - box.right, drawn: drawn !== null };
  });
  const root = document.documentElement;
  const wide = [...document.querySelectorAll("body *")]
    .filter(e => !e.closest(".wide, pre, .plot") && e.getBoundingClientRect().right > root.clientWidth + 1)
    .map(e => e.tagName + "." + e.className);
  const style = getComputedStyle(document.body);
  const seen = {
    said: window.__said, figures, wide, width: window.innerWidth, scroll: root.scrollWidth, client: root.clientWidth,
    dark: matchMedia("(prefers-color-scheme: dark)").matches, paper: style.backgroundColor, text: style.color,
  };
  parent.postMessage(btoa(unescape(encodeURIComponent(JSON.stringify(seen)))), "*");
}, 300));
</script>"#;

/// A window that is wide enough for any browser, with the page in a frame of the width in question.
fn frame(width: u32) -> String {
    format!(
        r#"<!DOCTYPE html><html style="color-scheme: light dark"><body style="margin: 0">
<script>addEventListener("message", e => {{
  const pre = document.createElement("pre");
  pre.id = "seen";
  pre.textContent = e.data;
  document.body.appendChild(pre);
}});</script>
<iframe src="page.html" style="border: 0; width: {width}px; height: 1000px"></iframe></body></html>"#
    )
}

fn browser() -> Option<PathBuf> {
    if let Ok(named) = std::env::var("PINODE_BROWSER") {
        return Some(named.into());
    }
    let paths = std::env::var_os("PATH")?;
    let names = ["chromium", "chromium-browser", "google-chrome"];
    std::env::split_paths(&paths)
        .flat_map(|folder| names.map(|name| folder.join(name)))
        .find(|path| path.is_file())
}

/// A report with everything in it that a report can have.
fn report_with_everything(dir: &Path) -> String {
    let mut diagnosis = diagnosis("slider");
    diagnosis.verdict = Verdict::Unexplained;
    diagnosis.unexplained = Some(unexplained(None));
    let path = write(
        dir,
        &diagnosis,
        &curves("slider"),
        "name = \"cart-pole\"\n",
        "pinode",
    )
    .unwrap();
    std::fs::read_to_string(path).unwrap()
}

/// What the browser sees of the page.
fn seen(browser: &Path, dir: &Path, page: &str, width: u32, dark: bool) -> Value {
    let framed = dir.join("frame.html");
    std::fs::write(&framed, frame(width)).unwrap();
    let page = page
        .replacen("<head>", &format!("<head>{LISTEN}"), 1)
        .replacen("</body>", &format!("{LOOK}</body>"), 1);
    std::fs::write(dir.join("page.html"), page).unwrap();
    let output = Command::new(browser)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
        ])
        .arg(format!("--user-data-dir={}", dir.join("profile").display()))
        .arg("--window-size=1400,1000")
        .arg(format!(
            "--blink-settings=preferredColorScheme={}",
            if dark { 0 } else { 1 }
        ))
        .args(["--virtual-time-budget=20000", "--dump-dom"])
        .arg(format!("file://{}", framed.display()))
        .output()
        .unwrap();
    let dom = String::from_utf8_lossy(&output.stdout);
    let coded = dom
        .split_once("<pre id=\"seen\">")
        .and_then(|(_, rest)| rest.split_once("</pre>"));
    let Some((coded, _)) = coded else {
        let said = String::from_utf8_lossy(&output.stderr);
        panic!("the page was not finished at {width} px: {said}");
    };
    serde_json::from_slice(&decoded(coded)).unwrap()
}

/// Base 64.
fn decoded(text: &str) -> Vec<u8> {
    let digits = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut bits = 0_u32;
    let mut count = 0;
    let mut out = Vec::new();
    for digit in text
        .bytes()
        .filter_map(|b| digits.iter().position(|d| *d == b))
    {
        bits = bits << 6 | u32::try_from(digit).unwrap();
        count += 6;
        if count >= 8 {
            count -= 8;
            out.push(u8::try_from(bits >> count & 0xff).unwrap());
        }
    }
    out
}

/// Of `rgb(r, g, b)`, 0 to 255.
fn brightness(colour: &Value) -> f64 {
    let digits = |c: char| !c.is_ascii_digit();
    let parts: Vec<f64> = colour
        .as_str()
        .unwrap()
        .split(digits)
        .filter_map(|part| part.parse().ok())
        .take(3)
        .collect();
    parts.iter().sum::<f64>() / 3.0
}

#[test]
fn the_report_is_whole_in_a_browser_wide_and_narrow_light_and_dark() {
    let dir = tempfile::tempdir().unwrap();
    let page = report_with_everything(dir.path());
    is_whole(dir.path(), &page, 11);
}

/// What `cartpole paper` writes has tables of many columns, roll-outs and histograms.
#[test]
fn a_sheet_is_whole_in_a_browser_wide_and_narrow_light_and_dark() {
    let dir = tempfile::tempdir().unwrap();
    let t: Vec<f64> = (0..100).map(|k| 0.02 * f64::from(k)).collect();
    let y: Vec<f64> = t.iter().map(|t| (5.0 * t).sin()).collect();
    let long = "a model with effects, and a network for the rest";
    let number = "0.0523 (0.0509–0.0537)";
    let mut section = Section::new("Roll-outs and errors of two models, with strong friction");
    section.paragraphs = vec!["Mean absolute errors over all samples. ".repeat(8)];
    section.tables = vec![Grid {
        heading: "strong friction, learnt from the whole recording".into(),
        texts: 2,
        columns: [
            "model",
            "starts",
            "x, m",
            "phi, rad",
            "x_dot, m/s",
            "phi_dot, rad/s",
        ]
        .map(String::from)
        .to_vec(),
        rows: [false, true]
            .map(|chosen| GridRow {
                cells: [long, "measured", number, number, number, number]
                    .map(String::from)
                    .to_vec(),
                chosen,
            })
            .to_vec(),
    }];
    let curve = |name, style| Curve {
        name,
        style,
        x: &t,
        y: &y,
    };
    let all = [
        curve("measured", Style::Measured),
        curve(long, Style::After),
        curve("another", Style::Other(0)),
    ];
    let lists: [(&str, Style, &[f64]); 2] = [(long, Style::After, &y), ("b", Style::Before, &t)];
    section.figures = vec![
        sheet::curves("x, roll-out 1", ["t, s", "x, m"], &all, "run"),
        sheet::histograms("errors of x, m", "x, m", &lists, "errors"),
    ];
    let sheet = Sheet {
        title: "An experiment on a virtual rig".into(),
        heading: "The errors of both coordinates and their rates over 0.6 s are a seventh".into(),
        sections: vec![section],
    };
    is_whole(dir.path(), &sheet.render().unwrap(), 2);
}

/// No complaint, all figures drawn, nothing too wide, and dark on light or light on dark.
fn is_whole(dir: &Path, page: &str, least: usize) {
    let Some(browser) = browser() else {
        eprintln!(
            "SKIPPED: no Chromium on the PATH and none named by PINODE_BROWSER: the page is not looked at in a browser"
        );
        return;
    };
    let figures = page.matches("Plotly.newPlot(").count()
        - figures::script().matches("Plotly.newPlot(").count();
    assert!(figures >= least, "{figures}");
    for (width, dark) in [(1280, false), (1280, true), (400, false), (400, true)] {
        let seen = seen(&browser, dir, page, width, dark);
        let at = format!("at {width} px, dark {dark}: {seen}");
        assert_eq!(seen["width"], width, "{at}");
        assert_eq!(seen["dark"], dark, "{at}");
        assert_eq!(seen["said"], serde_json::json!([]), "{at}");
        let drawn = seen["figures"].as_array().unwrap();
        assert_eq!(drawn.len(), figures, "{at}");
        for figure in drawn {
            let number = |key: &str| figure[key].as_f64().unwrap();
            assert!(number("width") > 200.0 && number("height") > 150.0, "{at}");
            assert!(number("beyond") < 1.0, "{at}");
            assert_eq!(figure["drawn"], true, "{at}");
        }
        assert!(seen["scroll"].as_f64() <= seen["client"].as_f64(), "{at}");
        assert_eq!(seen["wide"], serde_json::json!([]), "{at}");
        let (paper, text) = (brightness(&seen["paper"]), brightness(&seen["text"]));
        assert!(
            if dark { text - paper } else { paper - text } > 150.0,
            "{at}"
        );
    }
}
