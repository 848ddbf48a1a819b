//! The font of plots' text: the machine may have no fonts and no fontconfig, so it comes with the program.

use std::sync::Once;

use plotters::style::{FontStyle, register_font};

/// The name it goes by.
pub const FONT: &str = "sans-serif";

/// Makes it known; to be called before a plot is drawn.
///
/// # Panics
/// Never: the built-in font is a font.
pub fn register_plot_font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let registered = register_font(FONT, FontStyle::Normal, dejavu::sans::regular());
        assert!(registered.is_ok(), "the built-in font is a font");
    });
}
