//! Figures as PNG and PDF files: SVG rendered by resvg with a font of its own, so that they look the same on every system.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::fontdb::Source;
use resvg::usvg::{Options, Tree, WriteOptions};

use super::folder::{Claim, Folder, Owner};
use crate::error::{Error, Result};
use crate::files::WrittenFiles;
use crate::wording::Phrase;

/// The font of figures; its licence lies beside it.
const FONT: &[u8] = include_bytes!("fonts/DejaVuSans.ttf");

/// Its family.
const FAMILY: &str = "DejaVu Sans";

/// Pixels per px of a figure.
pub const SHARPNESS: f64 = 2.0;

/// A file format for figures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureFormat {
    /// Raster graphics.
    Png,
    /// Vector graphics, with letters as outlines.
    Pdf,
}

impl PictureFormat {
    fn ending(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Pdf => "pdf",
        }
    }
}

/// Renders SVG. Letters that the font brought along lacks are taken from the fonts of the system.
#[derive(Debug)]
pub struct SvgRenderer {
    options: Options<'static>,
}

impl SvgRenderer {
    /// Loads the fonts.
    pub fn new() -> Self {
        let mut options = Options::default();
        let fonts = options.fontdb_mut();
        fonts.load_font_source(Source::Binary(Arc::new(FONT)));
        fonts.load_system_fonts(); // which says what is sans-serif here
        fonts.set_sans_serif_family(FAMILY);
        Self { options }
    }

    /// Renders an SVG document with `sharpness` pixels per px.
    ///
    /// # Errors
    /// Why it cannot be drawn.
    pub fn pixels(&self, svg: &str, sharpness: f64) -> std::result::Result<Pixmap, String> {
        let tree = self.tree(svg)?;
        let side = |length: f32| (f64::from(length) * sharpness).round().max(1.0) as u32;
        let (width, height) = (side(tree.size().width()), side(tree.size().height()));
        let mut pixels = Pixmap::new(width, height).ok_or_else(|| format!("{width} × {height} pixels are too many"))?;
        resvg::render(&tree, Transform::from_scale(sharpness as f32, sharpness as f32), &mut pixels.as_mut());
        Ok(pixels)
    }

    /// Converts an SVG document to another format.
    ///
    /// # Errors
    /// Why it cannot be drawn.
    pub fn bytes(&self, svg: &str, format: PictureFormat) -> std::result::Result<Vec<u8>, String> {
        match format {
            PictureFormat::Png => self.pixels(svg, SHARPNESS)?.encode_png().map_err(|error| error.to_string()),
            PictureFormat::Pdf => {
                let outlines = self.tree(svg)?.to_string(&WriteOptions::default());
                let (conversion, page) = (svg2pdf::ConversionOptions::default(), svg2pdf::PageOptions::default());
                svg2pdf::to_pdf(&self.tree(&outlines)?, conversion, page).map_err(|error| error.to_string())
            }
        }
    }

    fn tree(&self, svg: &str) -> std::result::Result<Tree, String> {
        Tree::from_str(svg, &self.options).map_err(|error| error.to_string())
    }
}

impl Default for SvgRenderer {
    fn default() -> Self {
        Self::new()
    }
}

/// Converts all figures of `folder` (`.svg`), or those of these `names`, to these `formats` in the folder `out`, which may be the
/// same.
///
/// # Errors
/// [`Error::Read`] if there is no such figure; those of [`Folder::export`]. Write errors are in the result.
pub fn convert(
    folder: &Path,
    names: Option<&[String]>,
    formats: &[PictureFormat],
    out: &Path,
    claim: Claim,
) -> Result<WrittenFiles> {
    let read = |path: &Path, reason: String| Error::Read { path: path.to_path_buf(), reason };
    if !folder.exists() {
        return Err(read(folder, format!("there is no such folder; {} the folder of a run", Phrase::MakesFolder)));
    }
    let files: Vec<PathBuf> = match names {
        Some(names) => names.iter().map(|name| folder.join(format!("{}.svg", name.trim_end_matches(".svg")))).collect(),
        None => {
            let entries = std::fs::read_dir(folder).map_err(|error| read(folder, error.to_string()))?;
            let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
            let mut files: Vec<PathBuf> = paths.filter(|path| path.extension().is_some_and(|e| e == "svg")).collect();
            files.sort();
            files
        }
    };
    if files.is_empty() {
        return Err(read(folder, format!("it holds no figures (.svg); {} some", Phrase::LeavesFigures)));
    }
    let painter = SvgRenderer::new();
    let of = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    let name = of.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let fingerprint = of.display().to_string();
    let owner = Owner { kind: "picture".to_string(), name, source: of, fingerprint };
    let mut out = Folder::export(out, owner, claim)?;
    let mut pictures = out.exports();
    for file in files {
        let svg = std::fs::read_to_string(&file).map_err(|error| read(&file, error.to_string()))?;
        for format in formats {
            let name = Path::new(file.file_name().unwrap_or_default()).with_extension(format.ending());
            let path = pictures.path().join(&name);
            let bytes = painter.bytes(&svg, *format).map_err(|reason| Error::Write { path, reason });
            pictures.put_file(&name.to_string_lossy(), bytes);
        }
    }
    Ok(pictures.finish())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use super::*;
    use crate::report::svg::{Anchor, Colour, Svg};

    #[test]
    fn letters_of_figures_are_drawn_with_the_font_that_is_brought_along() {
        let mut svg = Svg::new(200.0, 40.0, "letters");
        svg.text((10.0, 30.0), "κ̄ΔL 10⁻⁶ m/s² ≤ ½", 17.0, Anchor::Start, Colour::INK);
        let svg = svg.finish();
        let dark = |renderer: &SvgRenderer| {
            let pixels = renderer.pixels(&svg, 1.0).unwrap();
            pixels.pixels().iter().filter(|pixel| pixel.alpha() > 0 && pixel.red() < 128).count()
        };
        let renderer = SvgRenderer::new();
        let mut alone = SvgRenderer { options: Options::default() };
        alone.options.fontdb_mut().load_font_source(Source::Binary(Arc::new(FONT)));
        alone.options.fontdb_mut().set_sans_serif_family(FAMILY);
        assert!(dark(&renderer) > 300, "{}", dark(&renderer));
        assert_eq!(dark(&renderer), dark(&alone));
    }
}
