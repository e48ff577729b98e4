//! The instruments from outside: what they say of a place whose scale and axes are no metres and no
//! z.

use crate::common::*;
use crate::process::said;
use serde_json::Value;

fn measure(arguments: &str) -> std::process::Output {
    binary().arg("measure").args(arguments.split_whitespace()).output().expect("the binary starts")
}

#[test]
fn a_weather_is_measured_as_it_was_asked_for() {
    let workshop = Workshop::new();
    let scene = workshop.scene("yard", yard().build(), &yard_metadata(2.0));
    let report = workshop.path("report");
    let output = measure(&format!(
        "{} --set fog.mor=80 --set rain.rate=5 --set rain.exposure=0.004 --set wind.speed=3 --set snow_cover.depth=0.2 \
         --instruments visibility,gauge,streaks,stake --size 120x80 --json --report {}",
        scene.display(),
        report.display()
    ));
    assert!(output.status.success(), "{}", said(&output));
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    let instruments = told["instruments"].as_array().unwrap();
    assert_eq!(instruments.len(), 4);
    let readings: Vec<&Value> =
        instruments.iter().flat_map(|instrument| instrument["readings"].as_array().unwrap()).collect();
    let of = |quantity: &str| {
        let found = readings.iter().find(|reading| reading["quantity"].as_str().unwrap().contains(quantity));
        let found = found.unwrap_or_else(|| panic!("no {quantity}"));
        [found["asked"].as_f64().unwrap(), found["measured"].as_f64().unwrap()]
    };
    // What is asked, from the options and the laws.
    let sigma = MOR_DEPTH / 80.0 + 0.365e-3 * 5f64.powf(0.63);
    for (quantity, asked) in
        [("MOR, blue", MOR_DEPTH / sigma), ("rain rate", 5.0), ("drift", 3.0), ("depth in the open", 0.2)]
    {
        let [wanted, measured] = of(quantity);
        println!("{quantity}: {wanted} {measured}");
        assert!((wanted / asked - 1.0).abs() < 1e-9 && (measured / asked - 1.0).abs() < 0.05, "{quantity}");
    }
    let page = String::from_utf8(workshop.read("report/report.html")).unwrap();
    assert!(page.contains("data:image/jpeg;base64,") && page.contains("<svg"));
    for file in ["readings.json", "readings.csv", "readings.md"] {
        assert!(report.join(file).metadata().unwrap().len() > 500, "{file}");
    }
}

#[test]
fn what_cannot_be_measured_is_said_in_a_line() {
    let yard = Shot::yard((48, 32));
    let scene = yard.scene.display();
    let fog = format!("{scene} --set fog.mor=50");
    for (arguments, says) in [
        (format!("{scene} --weather clear"), "has nothing for these instruments to measure"),
        (format!("{fog} --instruments gauge"), "has nothing for these instruments"),
        (
            format!("{scene} --instruments barometer"),
            "--instruments barometer: unknown; the instruments are visibility, rays",
        ),
        (format!("{fog} --set fidelity=paper"), "fidelity `paper` has no physical units"),
        (format!("{fog} --time inf"), "--time inf: give seconds"),
        ("nowhere.ply --set fog.mor=50".to_owned(), "nowhere.ply"),
        (format!("{fog} --report {scene}"), "cannot create the folder"),
    ] {
        let output = measure(&arguments);
        let error = said(&output);
        assert!(!output.status.success() && error.contains(says), "{arguments}: {error}");
        assert!(error.lines().filter(|line| line.starts_with("error")).count() == 1, "{error}");
    }
}
