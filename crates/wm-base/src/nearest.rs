//! Suggestions for misspelt names, by their distance in typing errors.

/// The names nearest to `text`, at most `most`, the nearest first; those too far off are left out.
#[must_use]
pub fn nearest<'a>(text: &str, names: impl Iterator<Item = &'a str>, most: usize) -> Vec<&'a str> {
    let text = text.to_lowercase();
    // An error or two for every four letters; more is another word.
    let length = text.chars().count();
    let limit = 1 + length / 4;
    // A distance is at least the difference of the lengths, and takes long to find of a long text.
    let is_as_long = |name: &&str| name.to_lowercase().chars().count().abs_diff(length) <= limit;
    let distance = |name: &str| strsim::damerau_levenshtein(&text, &name.to_lowercase());
    let mut near: Vec<(usize, &str)> = names
        .filter(is_as_long)
        .map(|name| (distance(name), name))
        .filter(|(errors, _)| *errors <= limit)
        .collect();
    near.sort_unstable();
    near.dedup();
    near.into_iter().take(most).map(|(_, name)| name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_come_first() {
        let names = ["target", "rotation", "time", "eye"];
        assert_eq!(nearest("Targte", names.into_iter(), 3), ["target"]);
        assert_eq!(nearest("tiem", names.into_iter(), 3), ["time"]);
        assert_eq!(nearest("tim", names.into_iter(), 1), ["time"]);
        assert_eq!(nearest("fog2", ["fog1", "fog2", "frog2"].into_iter(), 2), ["fog2", "fog1"]);
        let long = "t".repeat(1_000_000);
        for far in ["quaternion", "e", "", &long] {
            assert!(nearest(far, names.into_iter(), 3).is_empty(), "{far}");
        }
    }
}
