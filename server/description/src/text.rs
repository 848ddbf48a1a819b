//! Texts that people give: what a name may have, and how a text is shown that has anything.

/// Whether a character is not seen and makes others look like what they are not: controls, breaks of lines, and changes
/// of the direction of writing.
#[must_use]
pub fn is_hidden(c: char) -> bool {
    let turns = matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() || turns || matches!(c, '\u{2028}' | '\u{2029}')
}

/// The text with what is hidden in it written out, but for the ends of lines.
#[must_use]
pub fn escaped(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut shown, c| {
        match is_hidden(c) && c != '\n' {
            true => shown.extend(c.escape_unicode()),
            false => shown.push(c),
        }
        shown
    })
}

/// The text in `max_bytes` at most: of a longer one its beginning and its end.
#[must_use]
pub fn shortened(text: &str, max_bytes: usize) -> String {
    if text.len() <= max_bytes {
        return text.into();
    }
    const GAP: &str = " ... ";
    let kept = max_bytes.saturating_sub(GAP.len());
    let (head, tail) = (text.floor_char_boundary(kept - kept / 4), text.ceil_char_boundary(text.len() - kept / 4));
    [&text[..head], GAP, &text[tail..]].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_hidden_is_written_out_and_letters_of_all_languages_stay() {
        assert_eq!(escaped("Leber\nfoie 肝臓 كبد e\u{301}"), "Leber\nfoie 肝臓 كبد e\u{301}");
        assert_eq!(escaped("a\0b\u{202e}c\u{7f}\r"), "a\\u{0}b\\u{202e}c\\u{7f}\\u{d}");
    }

    #[test]
    fn a_long_text_keeps_its_ends() {
        assert_eq!(shortened("short", 5), "short");
        let long = shortened(&"ä".repeat(1000), 100);
        assert!(long.len() <= 100 && long.starts_with('ä') && long.ends_with('ä') && long.contains(" ... "), "{long}");
    }
}
