//! Snow that melts and falls again, and snow on sand.

use super::*;

/// Mean depth of a layer over a strip of a yard.
fn field(cover: &Cover, lying: &LyingCover, layer: usize, x: [f64; 2]) -> f64 {
    let ground = &cover.rings[0];
    let depth = &lying.settled[layer].depth;
    let is_in = |node: &usize| {
        let at = ground.point(*node);
        at[0] > x[0] && at[0] < x[1] && at[1] > 1.0 && at[1] < 5.0
    };
    let nodes: Vec<usize> = (0..depth.len()).filter(is_in).collect();
    assert!(nodes.len() > 100);
    nodes.iter().map(|node| f64::from(depth[*node])).sum::<f64>() / nodes.len() as f64
}

/// A yard of 12 m by 6 m that is dark, as a shade is, beyond 6 m.
fn half_shaded() -> Splats {
    let mut place = Builder::new(1);
    let color = |x: f64, _: f64| if x < 0.5 { [0.7; 3] } else { [0.12; 3] };
    place.surface(DVec3::ZERO, DVec3::X * 12.0, DVec3::Y * 6.0, 0.05, color);
    place.build()
}

/// A weather of an hour a second.
fn hours(sets: &[&str]) -> crate::Weather {
    testing::weather(sets.iter().chain(&["snow_cover.lapse=3600"]))
}

/// The shade is bare later than the sun, but it does get bare, and new snow lies on both; in
/// between nothing jumps.
#[test]
fn the_shade_is_bare_later_and_new_snow_lies_again() {
    let splats = half_shaded();
    let mut cover = cover_of(&splats, &Airflow::default(), [6.0, 3.0, 0.0]);
    let shade = |from: f64, to: f64| {
        let ground = &cover.rings[0];
        let near = |node: &usize| (from..to).contains(&ground.point(*node)[0]);
        let nodes: Vec<usize> = (0..ground.len()).filter(near).collect();
        nodes.iter().map(|node| f64::from(ground.shade[*node])).sum::<f64>() / nodes.len() as f64
    };
    println!("light {:.2} and {:.2}", shade(2.0, 4.0), shade(8.0, 10.0));
    assert!(shade(2.0, 4.0) > 0.95 && shade(8.0, 10.0) < 0.75);
    let auto = ["snow_cover.depth=auto", "snow_cover.hours=0", "snowfall.rate=0:0,1:4,2:0,12:0,13:4,14:0"];
    let asked = ["snow_cover.depth=0:0,2:0.04,12:0.04,14:0.08", "snow_cover.density=100"];
    for sets in [&auto[..], &asked[..]] {
        let weather = hours(&[sets, &["snow_cover.temperature=0:-3,2:-3,3:6,11:6,12:-3"]].concat());
        let mut at = |time: f64| {
            let sky = weather.at(time).prepare(&SITE);
            let lying = cover.lay_all(sky.cover());
            if sky.cover().is_empty() {
                return [0.0; 3];
            }
            let film = lying.splats.sh.chunks(3).filter(|rgb| rgb[0] < -1.0).count();
            [field(&cover, &lying, 0, [2.0, 4.0]), field(&cover, &lying, 0, [8.0, 10.0]), film as f64]
        };
        let times: Vec<f64> = (0..=160).map(|k| 0.1 * f64::from(k)).collect();
        let series: Vec<[f64; 3]> = times.iter().map(|time| at(*time)).collect();
        let bare = |k: usize| {
            let gone = |place: &usize| times[*place] > 2.0 && series[*place][k] < 1e-4;
            times[(0..series.len()).find(gone).unwrap()]
        };
        println!("{:.1} cm fell; bare at {:.1} h and {:.1} h", 100.0 * series[20][0], bare(0), bare(1));
        assert!(bare(1) > bare(0) + 0.4 && bare(1) < 11.0);
        // As long as the shade melts, the sun stays bare; then both are white again.
        assert!(series[115][0] < 1e-4 && series[160][0] > 0.03 && series[160][1] > 0.03, "{:?}", series[160]);
        for (pair, time) in series.windows(2).zip(&times) {
            for k in 0..2 {
                // 4 mm/h of new snow is 5 cm an hour at most, and what melts less.
                assert!((pair[1][k] - pair[0][k]).abs() < 0.007, "at {time}: {pair:?}");
            }
        }
        // Wet ground is drawn while it melts and some hours after, and where nothing melts never.
        let film = |time: f64| series[(10.0 * time) as usize][2];
        println!("wet splats at 2, 6, 9, 11.5, 15 h: {:?}", [2.0, 6.0, 9.0, 11.5, 15.0].map(film));
        assert!(film(2.0) == 0.0 && film(bare(0)) > 1000.0);
        assert_eq!(at(40.0)[2], 0.0);
    }
}

/// Mass is conserved while the shade still melts and new snow lies.
#[test]
fn water_is_kept_through_thaws() {
    let splats = half_shaded();
    let mut cover = cover_of(&splats, &Airflow::default(), [6.0, 3.0, 0.0]);
    let weather = hours(&[
        "snow_cover.depth=auto",
        "snow_cover.hours=1",
        "snow_cover.density=300",
        "snowfall.rate=0:4,2:4,3:0,12:0,13:4",
        "snow_cover.temperature=0:-3,3:-3,4:6,11:6,12:-3",
    ]);
    for (time, fell) in
        [(0.0, 4.0), (2.0, 12.0), (3.0, 14.0), (8.0, 14.0), (12.0, 14.0), (13.0, 16.0), (16.0, 28.0)]
    {
        let sky = weather.at(time).prepare(&SITE);
        let lying = cover.lay_all(&sky.cover()[..1]);
        let area = f64::from(cover.rings[0].cell).powi(2);
        let [lies, melted, shed] = account(&cover, &lying);
        let all: f64 = cover.rings[0].share.iter().map(|share| f64::from(*share) * area * fell).sum();
        assert!(((lies + melted + shed) / all - 1.0).abs() < 0.01, "{time}: {lies} {melted} {shed} {all}");
        // Counted from the places: each loses by its own light what can melt, as far as it has any.
        // Until then there were 26 degrees and hours, of which each melts 4 mm in a day.
        if time == 8.0 {
            let ground = &cover.rings[0];
            let melts = |node: usize| {
                let can = 26.0 / 6.0 * f64::from(0.5 + 0.5 * ground.shade[node]);
                can.min(fell * f64::from(ground.share[node])) * area
            };
            let by_hand: f64 = (0..ground.len()).map(melts).sum();
            assert!((melted / by_hand - 1.0).abs() < 0.01, "{melted} {by_hand}");
        }
    }
}

/// Snow lies on sand, and the sand is seen where there is no snow.
#[test]
fn snow_lies_on_sand() {
    let splats = half_shaded();
    let mut cover = cover_of(&splats, &Airflow::default(), [6.0, 3.0, 0.0]);
    let weather =
        |snow: f64| testing::weather([format!("snow_cover.depth={snow}"), "dust_cover.depth=0.03".into()]);
    let mut lying = |snow: f64| {
        let sky = weather(snow).at(0.0).prepare(&SITE);
        (cover.lay_all(sky.cover()), sky.cover().len())
    };
    // Sand is redder than it is blue.
    let sand = |lying: &LyingCover| lying.splats.sh.chunks(3).filter(|rgb| rgb[0] - rgb[2] > 0.2).count();
    let [(bare, one), (thin, two), (deep, both)] = [0.0, 0.005, 0.2].map(&mut lying);
    let counts = [&bare, &thin, &deep].map(|lying| (sand(lying), lying.splats.len()));
    println!("sand and all: {counts:?}");
    assert_eq!((one, two, both), (1, 2, 2));
    assert!(counts[0].0 > 10_000 && counts[1].0 >= counts[0].0 && counts[2].0 < counts[0].0 / 10);
    assert_eq!(bare.settled.len(), cover.rings.len());
    // The snow is above the sand wherever it is drawn: both splats of a node are at one place.
    let heights = |lying: &LyingCover, is_sand: bool| -> Vec<f32> {
        let is = |rgb: &[f32]| (rgb[0] - rgb[2] > 0.2) == is_sand;
        let all = lying.splats.sh.chunks(3).zip(&lying.splats.means);
        all.filter(|(rgb, _)| is(rgb)).map(|(_, mean)| mean[2]).collect()
    };
    let mean = |heights: &[f32]| heights.iter().sum::<f32>() / heights.len() as f32;
    let (low, high) = (mean(&heights(&thin, true)), mean(&heights(&thin, false)));
    println!("sand at {low:.4} m, snow at {high:.4} m");
    assert!(high > low + 0.005 && high < low + 0.02);
    // Alone each is as it is without the other.
    let alone = cover.lay_all(&weather(0.0).at(0.0).prepare(&SITE).cover()[..1]);
    assert!(alone.splats == bare.splats && alone.buried == bare.buried);
}
