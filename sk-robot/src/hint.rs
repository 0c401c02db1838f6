//! What may have been meant by a name that is not known.

/// `did you mean …?`, or the whole list if nothing is near.
pub fn hint<'a>(found: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    let known: Vec<&str> = known.into_iter().collect();
    let near = known
        .iter()
        .map(|name| (strsim::damerau_levenshtein(found, name), *name))
        .filter(|(distance, name)| *distance <= name.len().max(found.len()).div_ceil(3))
        .min();
    match near {
        Some((_, name)) => format!("did you mean `{name}`?"),
        None if known.is_empty() => "there are none".to_owned(),
        None => format!("there are {}", known.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_offered_and_all_of_them_if_none_is_near() {
        assert_eq!(hint("hots", ["host", "web"]), "did you mean `host`?");
        assert_eq!(hint("banana", ["host", "web"]), "there are host, web");
        assert_eq!(hint("x", []), "there are none");
    }
}
