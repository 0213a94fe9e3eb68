//! A drawing as PNG, for mail and slides.
//!
//! The font comes with the program: the renderer finds none by itself, and text without a font
//! silently disappears. Invariant: needs nothing installed, same drawing, same bytes.

use std::sync::Arc;

use resvg::{tiny_skia, usvg};
use thiserror::Error;

/// Why a drawing could not become a picture.
#[derive(Debug, Error)]
pub enum PngError {
    /// Not a drawing.
    #[error("the drawing cannot be read")]
    Drawing(#[from] usvg::Error),
    /// No memory for so many pixels, or none at all.
    #[error("no picture of {width} x {height} pixels can be made")]
    Size {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
    },
    /// The picture could not be packed.
    #[error("the picture cannot be encoded: {0}")]
    Encoding(String),
}

/// Renders an SVG at `scale` pixels for each unit of the drawing.
///
/// # Errors
/// When the text is no SVG or the picture is too large.
pub fn render(svg: &str, scale: f32) -> Result<Vec<u8>, PngError> {
    let mut options = usvg::Options { font_family: "DejaVu Sans".to_owned(), ..usvg::Options::default() };
    let fonts = Arc::make_mut(&mut options.fontdb);
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.load_font_data(dejavu::sans::bold().to_vec());
    fonts.set_sans_serif_family("DejaVu Sans");
    let tree = usvg::Tree::from_str(svg, &options)?;
    let [width, height] =
        [tree.size().width(), tree.size().height()].map(|side| (side * scale).ceil() as u32);
    let mut picture = tiny_skia::Pixmap::new(width, height).ok_or(PngError::Size { width, height })?;
    resvg::render(&tree, tiny_skia::Transform::from_scale(scale, scale), &mut picture.as_mut());
    picture.encode_png().map_err(|error| PngError::Encoding(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::offline::draw::svg::{Anchor, Svg, TextStyle};

    #[test]
    fn text_is_not_lost() {
        let style = TextStyle { size: 30.0, colour: "black", anchor: Anchor::Start, is_bold: false };
        let with_text = |text: &str| {
            let mut svg = Svg::new(120.0, 40.0);
            svg.text([5.0, 30.0], style, text);
            let png = render(&svg.finish("test"), 1.0).unwrap();
            let picture = tiny_skia::Pixmap::decode_png(&png).unwrap();
            picture.pixels().iter().filter(|pixel| pixel.red() < 128).count()
        };
        assert_eq!(with_text(""), 0);
        let dark = with_text("25 µm");
        assert!(dark > 200, "{dark} dark pixels");
    }

    #[test]
    fn what_is_no_drawing_is_refused() {
        assert!(matches!(render("not a drawing", 1.0), Err(PngError::Drawing(_))));
    }
}
