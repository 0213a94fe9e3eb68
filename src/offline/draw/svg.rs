//! A drawing in the making: SVG written by hand, one element for each call.
//!
//! Lengths are user units of the drawing (at its natural size, pixels of 1/96 inch), Y points down.
//! Invariant: text is escaped, numbers have two decimals at most, the same calls give the same bytes.

use std::fmt::Write;

/// Where text hangs on its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// The point is its left end.
    Start,
    /// The point is its middle.
    Middle,
    /// The point is its right end.
    End,
}

/// How a line looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    /// CSS colour.
    pub colour: &'static str,
    /// Width.
    pub width: f64,
    /// Lengths of dash and gap; solid without.
    pub dash: Option<[f64; 2]>,
}

impl Stroke {
    /// A solid line.
    pub const fn solid(colour: &'static str, width: f64) -> Self {
        Self { colour, width, dash: None }
    }
    /// A dashed line.
    pub const fn dashed(colour: &'static str, width: f64, dash: [f64; 2]) -> Self {
        Self { colour, width, dash: Some(dash) }
    }
    fn attributes(&self) -> String {
        let mut text = format!(r#"stroke="{}" stroke-width="{}""#, self.colour, number(self.width));
        if let Some([dash, gap]) = self.dash {
            text += &format!(r#" stroke-dasharray="{} {}""#, number(dash), number(gap));
        }
        text
    }
}

/// How text looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextStyle {
    /// Height of the font.
    pub size: f64,
    /// CSS colour.
    pub colour: &'static str,
    /// Where it hangs.
    pub anchor: Anchor,
    /// Bold.
    pub is_bold: bool,
}

/// The drawing.
#[derive(Clone, Debug)]
pub struct Svg {
    width: f64,
    height: f64,
    body: String,
}

impl Svg {
    /// An empty white sheet.
    pub fn new(width: f64, height: f64) -> Self {
        let mut svg = Self { width, height, body: String::new() };
        svg.element(format_args!(
            r#"<rect width="{}" height="{}" fill="white"/>"#,
            number(width),
            number(height)
        ));
        svg
    }

    /// A straight line.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], stroke: Stroke) {
        let [x1, y1, x2, y2] = [from[0], from[1], to[0], to[1]].map(number);
        let look = stroke.attributes();
        self.element(format_args!(r#"<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" {look}/>"#));
    }

    /// A line through many points.
    pub fn polyline(&mut self, points: &[[f64; 2]], stroke: Stroke) {
        if points.len() < 2 {
            return;
        }
        let mut list = String::with_capacity(points.len() * 12);
        for [x, y] in points {
            if !list.is_empty() {
                list.push(' ');
            }
            list += &number(*x);
            list.push(',');
            list += &number(*y);
        }
        let look = stroke.attributes();
        self.element(format_args!(
            r#"<polyline points="{list}" fill="none" stroke-linejoin="round" {look}/>"#
        ));
    }

    /// A circle, filled or not.
    pub fn circle(&mut self, centre: [f64; 2], radius: f64, fill: &str, stroke: Stroke) {
        let [x, y, r] = [centre[0], centre[1], radius].map(number);
        let look = stroke.attributes();
        self.element(format_args!(r#"<circle cx="{x}" cy="{y}" r="{r}" fill="{fill}" {look}/>"#));
    }

    /// A filled rectangle without edge.
    pub fn area(&mut self, corner: [f64; 2], size: [f64; 2], fill: &str) {
        let [x, y, width, height] = [corner[0], corner[1], size[0], size[1]].map(number);
        self.element(format_args!(
            r#"<rect x="{x}" y="{y}" width="{width}" height="{height}" fill="{fill}"/>"#
        ));
    }

    /// A rectangle without filling.
    pub fn frame(&mut self, corner: [f64; 2], size: [f64; 2], stroke: Stroke) {
        let [x, y, width, height] = [corner[0], corner[1], size[0], size[1]].map(number);
        let look = stroke.attributes();
        self.element(format_args!(
            r#"<rect x="{x}" y="{y}" width="{width}" height="{height}" fill="none" {look}/>"#
        ));
    }

    /// One line of text, on its baseline.
    pub fn text(&mut self, at: [f64; 2], style: TextStyle, text: &str) {
        self.write_text(at, style, "", text);
    }

    /// One line of text with a white edge, to be read on top of lines.
    pub fn text_on_lines(&mut self, at: [f64; 2], style: TextStyle, text: &str) {
        self.write_text(at, style, r#" stroke="white" stroke-width="3" paint-order="stroke""#, text);
    }

    /// Text that runs upwards, for the axis on the left.
    pub fn text_upwards(&mut self, at: [f64; 2], style: TextStyle, text: &str) {
        let turn = format!(r#" transform="rotate(-90 {} {})""#, number(at[0]), number(at[1]));
        self.write_text(at, style, &turn, text);
    }

    /// The finished drawing with a title for those who cannot see it.
    pub fn finish(self, title: &str) -> String {
        let [width, height] = [self.width, self.height].map(number);
        let title = escaped(title);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"'DejaVu Sans', Verdana, sans-serif\" role=\"img\">\n\
             <title>{title}</title>\n{}</svg>\n",
            self.body
        )
    }

    fn write_text(&mut self, at: [f64; 2], style: TextStyle, extra: &str, text: &str) {
        let [x, y, size] = [at[0], at[1], style.size].map(number);
        let anchor = match style.anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let weight = if style.is_bold { r#" font-weight="bold""# } else { "" };
        let (colour, text) = (style.colour, escaped(text));
        self.element(format_args!(
            r#"<text x="{x}" y="{y}" font-size="{size}" fill="{colour}" text-anchor="{anchor}"{weight}{extra}>{text}</text>"#
        ));
    }

    fn element(&mut self, element: std::fmt::Arguments<'_>) {
        writeln!(self.body, "{element}").expect("writing to a string cannot fail");
    }
}

/// Two decimals are a fiftieth of a printed hair; trailing zeros are dropped.
fn number(value: f64) -> String {
    let text = format!("{value:.2}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".to_owned() } else { short.to_owned() }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_text_is_escaped() {
        assert_eq!([1.0, -0.001, 2.5, 1.236, 100.0].map(number), ["1", "0", "2.5", "1.24", "100"]);
        let mut svg = Svg::new(10.0, 10.0);
        let style = TextStyle { size: 3.0, colour: "black", anchor: Anchor::Start, is_bold: false };
        svg.text([1.0, 2.0], style, "a<b & \"c\"");
        assert!(svg.finish("t").contains("a&lt;b &amp; &quot;c&quot;</text>"));
    }
}
