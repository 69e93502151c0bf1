//! The page's files, as they were when this program was built: nothing is loaded from elsewhere.

/// (path, kind, text).
pub(crate) const FILES: [(&str, &str, &str); 9] = [
    ("/", HTML, include_str!("page/index.html")),
    (
        "/style.css",
        "text/css; charset=utf-8",
        include_str!("page/style.css"),
    ),
    ("/icon.svg", "image/svg+xml", include_str!("page/icon.svg")),
    ("/page.js", SCRIPT, include_str!("page/page.js")),
    ("/events.js", SCRIPT, include_str!("page/events.js")),
    ("/pictures.js", SCRIPT, include_str!("page/pictures.js")),
    ("/traces.js", SCRIPT, include_str!("page/traces.js")),
    ("/words.js", SCRIPT, include_str!("page/words.js")),
    ("/control.js", SCRIPT, include_str!("page/control.js")),
];

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_loaded_from_elsewhere_and_all_that_is_loaded_is_there() {
        for (path, _, text) in FILES {
            // The icon's namespace is a name, not an address that is loaded.
            let addresses = text.replace("http://www.w3.org/2000/svg", "");
            assert!(
                !addresses.contains("//www.")
                    && !addresses.contains("http://")
                    && !addresses.contains("https://")
            );
            for part in text.split(['"', '\'']) {
                let is_file = [".js", ".css", ".svg"].iter().any(|end| part.ends_with(end));
                let name = part.trim_start_matches("./");
                if is_file && !part.contains(char::is_whitespace) {
                    let is_there = FILES.iter().any(|(path, ..)| &path[1..] == name);
                    assert!(is_there, "{path} wants {name}");
                }
            }
        }
    }
}
