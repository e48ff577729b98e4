//! What was probably meant: names by their distance in typing errors.

/// The names nearest to `text`, at most `most`, the nearest first; those too far off are left out.
pub fn nearest<'a>(text: &str, names: impl Iterator<Item = &'a str>, most: usize) -> Vec<&'a str> {
    let text = text.to_lowercase();
    // A third of the letters wrong is no typing error any more.
    let limit = (text.chars().count() / 3).max(2);
    let mut near: Vec<(usize, &str)> =
        names.map(|name| (distance(&text, &name.to_lowercase()), name)).filter(|n| n.0 <= limit).collect();
    near.sort();
    near.dedup();
    near.into_iter().take(most).map(|n| n.1).collect()
}

/// Fewest letters to insert, leave out, replace or swap with the next to turn `a` into `b`.
fn distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut before: Vec<usize> = Vec::new();
    let mut last: Vec<usize> = (0..=b.len()).collect();
    for i in 1..=a.len() {
        let mut row = vec![i];
        for j in 1..=b.len() {
            let same = a[i - 1] == b[j - 1];
            let mut cost = (last[j] + 1).min(row[j - 1] + 1).min(last[j - 1] + usize::from(!same));
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                cost = cost.min(before[j - 2] + 1);
            }
            row.push(cost);
        }
        before = std::mem::replace(&mut last, row);
    }
    last[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn typing_errors_are_counted() {
        for (a, b, expected) in [
            ("", "", 0),
            ("a", "", 1),
            ("eye", "eye", 0),
            ("yee", "eye", 1),
            ("time", "tiem", 1),
            ("fov", "fovy", 1),
            ("abc", "xyz", 3),
        ] {
            assert_eq!((distance(a, b), distance(b, a)), (expected, expected), "{a} {b}");
        }
    }

    #[test]
    fn the_nearest_come_first() {
        let names = ["target", "rotation", "time", "eye"];
        assert_eq!(nearest("Targte", names.into_iter(), 3), ["target"]);
        assert_eq!(nearest("tim", names.into_iter(), 1), ["time"]);
        assert!(nearest("quaternion", names.into_iter(), 3).is_empty());
    }
}
