//! The bench command, as small as it goes: that it measures and what it prints, not how fast.

use crate::common::run;
use serde_json::Value;

fn bench(options: &[&str]) -> Value {
    let usual = ["bench", "--splats", "400", "--size", "64x48", "--frames", "2", "--json"];
    serde_json::from_slice(&run(&[&usual, options].concat()).stdout).unwrap()
}

#[test]
fn frames_and_steps_are_measured() {
    let frames = bench(&[]);
    let scene = &frames[0];
    assert_eq!((scene["splats"].as_u64(), scene["width"].as_u64()), (Some(400), Some(64)));
    let cases = scene["cases"].as_array().unwrap();
    assert!(cases.len() >= 8 && cases.iter().all(|case| case["wall_ms"].as_f64().unwrap() > 0.0));

    let steps = bench(&["--training", "--sh-degree", "1"]);
    let scene = &steps[0];
    assert_eq!((scene["splats"].as_u64(), scene["sh_degree"].as_u64()), (Some(400), Some(1)));
    assert!(scene["visible"].as_u64().unwrap() > 100);
    let parts =
        ["forward_ms", "loss_ms", "backward_ms", "optimizer_ms"].map(|key| scene[key].as_f64().unwrap());
    let whole = scene["wall_ms"].as_f64().unwrap();
    assert!(parts.iter().all(|part| *part > 0.0) && whole > 0.0, "{scene}");
}

#[test]
fn sensors_are_measured() {
    let sensors = bench(&["--sensors"]);
    let cases = sensors[0]["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 7);
    assert!(cases.iter().all(|case| case["wall_ms"].as_f64().unwrap() > 0.0), "{sensors}");
    assert!(cases[..3].iter().all(|case| case["points"].as_u64().unwrap() > 1000), "{sensors}");
    assert!(cases[3..].iter().all(|case| case["cpu_ratio"].as_f64().unwrap() > 0.5), "{sensors}");
}

#[test]
fn the_table_of_the_paper_has_its_figures_and_ours() {
    let table = bench(&["--paper"]);
    let rows = table["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 6);
    assert_eq!(rows[3]["fps"], serde_json::json!([83.30, 31.27, 10.42, 58.24]));
    for row in &rows[4..] {
        let fps = row["fps"].as_array().unwrap();
        assert!(fps.len() == 4 && fps.iter().all(|fps| fps.as_f64().unwrap() > 0.0), "{row}");
    }
    assert_eq!(table["by_pixels"][0]["points"].as_array().unwrap().len(), 4);
}
