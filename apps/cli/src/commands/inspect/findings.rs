//! The findings of `inspect`: every doubt and note about an input, each with what to do.

use weather_magician::Scene;
use wm_scene::health::{FaultCounts, Health};
use wm_scene::survey::Survey;
use wm_scene::{Remark, Severity};

/// Returns the findings about a scene: those of its reader, of its splats, and of the facts about
/// the place.
pub(crate) fn of_scene(scene: &Scene, health: &Health, survey: &Survey) -> Vec<Remark> {
    let mut findings = scene.remarks.clone();
    findings.extend(of_splats(health));
    findings.extend(survey.remarks());
    findings.extend(survey.likely_facts().map(|text| Remark::note("likely-facts", text)));
    findings
}

/// Returns a finding for each kind of fault of splats, with its count and how it is treated.
fn of_splats(health: &Health) -> Vec<Remark> {
    let FaultCounts { mean, scale, opacity, quat, zero_quat, sh, blank } = health.faults;
    let broken = "not rendered: `render --repair` leaves them out";
    let doubt = |count, code, what| (count, Severity::Doubt, code, what, broken);
    [
        doubt(mean, "positions-unusable", "positions that are NaN, infinite or beyond 10^10 units"),
        doubt(scale, "scales-unusable", "scales that are NaN, infinite or above e^30 units"),
        doubt(opacity, "opacities-unusable", "opacities that are NaN"),
        doubt(quat, "rotations-unusable", "rotations that are NaN, infinite or absurdly long"),
        doubt(sh, "colours-unusable", "colours that are NaN, infinite or absurdly bright"),
        doubt(blank, "rows-of-zeros", "rows of zeros"),
        (zero_quat, Severity::Note, "zero-rotations", "rotations that are zero", "taken for no rotation"),
        (
            health.duplicates,
            Severity::Note,
            "duplicates",
            "splats that are copies of another",
            "drawn as they are",
        ),
        (
            health.invisible,
            Severity::Note,
            "invisible",
            "splats too faint to be seen (opacity below 1/255)",
            "never drawn",
        ),
        (health.oversized, Severity::Note, "oversized", "splats larger than the scene", "drawn as they are"),
    ]
    .into_iter()
    .filter(|(count, ..)| *count > 0)
    .map(|(count, severity, code, what, treatment)| Remark {
        severity,
        code,
        text: format!("{count} {what}: {treatment}"),
    })
    .collect()
}

/// Prints the findings for people, doubts first.
pub(crate) fn print(findings: &[Remark]) {
    println!("What is wrong");
    if findings.is_empty() {
        println!("  nothing");
    }
    for severity in [Severity::Doubt, Severity::Note] {
        for finding in findings.iter().filter(|finding| finding.severity == severity) {
            println!("  {finding}");
        }
    }
}
