//! Classes of public data sets for the labels of splats, by name.

/// Names of labels, and the class of a point there: names, SemanticKITTI
/// (`config/semantic-kitti.yaml` of semantic-kitti-api), and nuScenes-lidarseg (the index is the
/// place of its name in [`LIDARSEG_NAMES`]).
const CLASSES: &[(&[&str], u16, u8)] = &[
    (&["road", "street", "lane", "driveable-surface"], 40, 24),
    (&["parking"], 44, 24),
    (&["lane-marking", "road-marking"], 60, 24),
    (&["sidewalk", "pavement", "kerb", "curb"], 48, 26),
    (&["other-ground", "ground", "path", "flat", "rail-track"], 49, 25),
    (&["terrain", "lawn", "grass", "soil"], 72, 27),
    (&["building", "house", "facade", "roof"], 50, 28),
    (&["fence"], 51, 28),
    (&["other-structure", "wall", "bridge", "tunnel", "guard-rail", "manmade"], 52, 28),
    (&["vegetation", "plant", "tree", "bush", "hedge"], 70, 30),
    (&["trunk"], 71, 30),
    (&["pole", "lamp", "street-light", "traffic-light"], 80, 28),
    (&["traffic-sign", "sign"], 81, 28),
    (&["object", "other-object"], 99, 29),
    (&["water"], 0, 25),
    (&["car"], 10, 17),
    (&["bicycle"], 11, 14),
    (&["bus"], 13, 16),
    (&["motorcycle"], 15, 21),
    (&["truck"], 18, 23),
    (&["other-vehicle"], 20, 29),
    (&["person", "pedestrian"], 30, 2),
    (&["bicyclist", "rider"], 31, 14),
    (&["motorcyclist"], 32, 21),
];

/// Names of nuScenes-lidarseg by index.
pub(super) const LIDARSEG_NAMES: [&str; 32] = [
    "noise",
    "animal",
    "human.pedestrian.adult",
    "human.pedestrian.child",
    "human.pedestrian.construction_worker",
    "human.pedestrian.personal_mobility",
    "human.pedestrian.police_officer",
    "human.pedestrian.stroller",
    "human.pedestrian.wheelchair",
    "movable_object.barrier",
    "movable_object.debris",
    "movable_object.pushable_pullable",
    "movable_object.trafficcone",
    "static_object.bicycle_rack",
    "vehicle.bicycle",
    "vehicle.bus.bendy",
    "vehicle.bus.rigid",
    "vehicle.car",
    "vehicle.construction",
    "vehicle.emergency.ambulance",
    "vehicle.emergency.police",
    "vehicle.motorcycle",
    "vehicle.trailer",
    "vehicle.truck",
    "flat.driveable_surface",
    "flat.other",
    "flat.sidewalk",
    "flat.terrain",
    "static.manmade",
    "static.other",
    "static.vegetation",
    "vehicle.ego",
];

/// The class of SemanticKITTI of each label, by its number; `unlabeled` (0) where no name is alike.
pub(super) fn semantic_kitti_classes(labels: &[String]) -> Vec<u16> {
    std::iter::once(0).chain(labels.iter().map(|name| class(name).map_or(0, |class| class.0))).collect()
}

/// The index of nuScenes-lidarseg of each label, by its number; `static.other` where no name is
/// alike, as 0 is noise there.
pub(super) fn lidarseg_classes(labels: &[String]) -> Vec<u8> {
    const OTHER_CLASS: u8 = 29;
    std::iter::once(OTHER_CLASS)
        .chain(labels.iter().map(|name| class(name).map_or(OTHER_CLASS, |class| class.1)))
        .collect()
}

fn class(name: &str) -> Option<(u16, u8)> {
    let name = name.to_lowercase().replace([' ', '_'], "-");
    CLASSES
        .iter()
        .find(|(names, ..)| names.contains(&name.as_str()))
        .map(|(_, kitti, lidarseg)| (*kitti, *lidarseg))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_find_their_classes() {
        let labels = ["Road", "traffic sign", "unicorn"].map(String::from);
        assert_eq!(semantic_kitti_classes(&labels), [0, 40, 81, 0]);
        assert_eq!(lidarseg_classes(&labels), [29, 24, 28, 29]);
    }

    #[test]
    fn classes_of_lidarseg_bear_names_of_their_kind() {
        for (name, index) in [
            ("road", 24),
            ("water", 25),
            ("sidewalk", 26),
            ("lawn", 27),
            ("car", 17),
            ("tree", 30),
            ("person", 2),
        ] {
            assert_eq!(class(name).unwrap().1, index, "{name}");
        }
        let name = |label| LIDARSEG_NAMES[usize::from(class(label).unwrap().1)];
        assert_eq!([name("road"), name("car")], ["flat.driveable_surface", "vehicle.car"]);
        assert_eq!([name("bus"), name("motorcycle")], ["vehicle.bus.rigid", "vehicle.motorcycle"]);
        assert_eq!([name("truck"), name("bicycle")], ["vehicle.truck", "vehicle.bicycle"]);
    }
}
