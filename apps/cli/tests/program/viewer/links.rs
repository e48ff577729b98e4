//! Links to views.

use crate::viewer::yard_viewer;
use serde_json::json;

#[test]
fn a_link_opens_the_state_that_it_was_made_of() {
    let (_workshop, viewer) = yard_viewer();
    let start = viewer.json("GET", "/state", &json!({}));
    let patch = json!({
        "weather": { "name": "<b>a fog</b>", "fog": { "mor": 81.12345678901234 } }, "time": 2.25, "output": "depth", "divider": 0.5,
        "camera": { "eye": [0.5, -12.123456789012345, 1.8], "rotation": [0.7123, 0.7, 0.012, -0.003], "fov": 47.3 },
        "size": [90, 60],
    });
    let (status, link) = viewer.ask("POST", "/link", &[], patch.to_string().as_bytes());
    let link = String::from_utf8(link).unwrap();
    assert!(status == 200 && link.starts_with("v=1&w=") && link.ends_with("&t=2.25&o=depth&d=0.5"), "{link}");
    let (status, opened) = viewer.ask("POST", "/unlink", &[], link.as_bytes());
    assert_eq!(status, 200, "{}", String::from_utf8_lossy(&opened));
    // Everything but the size and the quality, which are the screen's.
    let mut expected = start.clone();
    expected.as_object_mut().unwrap().extend(patch.as_object().unwrap().clone());
    expected["size"] = start["size"].clone();
    let opened: serde_json::Value = serde_json::from_slice(&opened).unwrap();
    assert_eq!(opened, expected);
    // Nothing was changed.
    assert_eq!(viewer.json("GET", "/state", &json!({})), start);

    let long = json!({ "weather": { "about": "x".repeat(250_000) } }).to_string();
    assert_eq!(viewer.ask("POST", "/link", &[], long.as_bytes()).0, 200);
    for (path, body, expected) in [
        ("/link", "{\"tiem\": 1}".to_owned(), "unknown field `tiem`"),
        ("/link", "{\"weather\": {\"fgo\": {}}}".to_owned(), "did you mean `fog`"),
        ("/unlink", String::new(), "it has no version"),
        ("/unlink", link.replace("v=1", "v=2"), "this page is older"),
        ("/unlink", link.clone() + "&<script>=1", "unknown key `<script>`"),
        ("/unlink", link.replace("t=2.25", "t=1e7"), "time 10000000"),
        ("/unlink", "x".repeat(100_000), "bytes are too many"),
    ] {
        viewer.refuses("POST", path, &body, expected);
    }
}
