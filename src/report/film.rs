//! Films of a moving rod: GIF, or MP4 by ffmpeg.

use std::borrow::Cow;
use std::cmp::Ordering;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::{ControlFlow, RangeInclusive};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use gif::{Encoder, Frame, Repeat};

use super::chart::{Chart, Mark, Scale, Series};
use super::picture::SvgRenderer;
use crate::error::{Error, Result};
use crate::files::{write_atomically, write_error};

/// Settings of a film.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilmSettings {
    /// Frames per second.
    pub per_second: u32,
    /// Seconds of the run per second of the film.
    pub speed: f64,
    /// Pixels per px of the figure.
    pub sharpness: f64,
    /// First and last time that it shows, s, limited to those of the run.
    pub window: [f64; 2],
}

impl Default for FilmSettings {
    fn default() -> Self {
        Self { per_second: 25, speed: 1.0, sharpness: 1.0, window: [f64::NEG_INFINITY, f64::INFINITY] }
    }
}

/// Most frames of a film.
const MAX_FRAMES: f64 = 100_000.0;

/// Most frames per second of a GIF: its delays are hundredths of a second, and many viewers take a delay of one for ten.
const MAX_GIF_RATE: u32 = 50;

/// Allowed pixels per px of the figure, which is some hundreds of px wide.
const SHARPNESS: RangeInclusive<f64> = 0.05..=20.0;

/// The motion of a rod: positions in rows, one per time with one entry per node.
#[derive(Debug, Clone, Copy)]
pub struct RodMotion<'a> {
    /// Name of the scene.
    pub name: &'a str,
    /// Times, s, increasing.
    pub times: &'a [f64],
    /// Positions, m.
    pub x: &'a [f64],
    /// Positions, m.
    pub y: &'a [f64],
}

impl RodMotion<'_> {
    /// The rod at a time, by linear interpolation.
    fn at(&self, time: f64) -> Vec<(f64, f64)> {
        let nodes = self.x.len() / self.times.len();
        let next = self.times.partition_point(|t| *t <= time).clamp(1, self.times.len() - 1);
        let [from, to] = [self.times[next - 1], self.times[next]];
        let part = ((time - from) / (to - from)).clamp(0.0, 1.0);
        let at =
            |values: &[f64], k: usize| (1.0 - part) * values[(next - 1) * nodes + k] + part * values[next * nodes + k];
        (0..nodes).map(|k| (at(self.x, k), at(self.y, k))).collect()
    }

    /// Corners of the bounding box of the rod from `first` to `last`.
    fn corners(&self, [first, last]: [f64; 2]) -> Vec<(f64, f64)> {
        let nodes = self.x.len() / self.times.len();
        // With the times next to them, between which its first and last picture lie.
        let from = self.times.partition_point(|t| *t <= first).saturating_sub(1);
        let until = (self.times.partition_point(|t| *t < last) + 1).min(self.times.len());
        let ends = |values: &[f64]| {
            let finite = || values[nodes * from..nodes * until].iter().copied().filter(|x| x.is_finite());
            [finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max)]
        };
        let ([left, right], [low, high]) = (ends(self.x), ends(self.y));
        vec![(left, low), (right, high)]
    }

    /// The frame at a time, with axes for all between `corners`.
    fn svg(&self, time: f64, corners: &[(f64, f64)]) -> String {
        let rod = self.at(time);
        let head = rod.first().copied().into_iter().collect();
        let series = vec![
            Series::new("", corners.to_vec(), Mark::Unseen),
            Series::new("", rod, Mark::Line),
            Series::new("", head, Mark::Dots),
        ];
        Chart::new(format!("{}, t = {time:.2} s", self.name), "x (m)", "y (m)", Scale::Equal, series).svg()
    }
}

impl FilmSettings {
    /// Checks a film of a run from the first to the last of these times (s) that is to be written to `path`.
    ///
    /// # Errors
    /// [`Error::Write`] for an extension other than .gif and .mp4, a run of one time, a window outside the run, a
    /// sharpness that is out of range, and rates that are not positive or too large.
    pub fn check(&self, path: &Path, run: [f64; 2]) -> Result<()> {
        self.plan(path, run).map(|_| ())
    }

    /// The number of pictures of such a film.
    ///
    /// # Errors
    /// Those of [`check`](Self::check).
    pub fn picture_count(&self, path: &Path, run: [f64; 2]) -> Result<usize> {
        self.plan(path, run).map(|(_, _, count)| count as usize)
    }

    /// The checked film: whether it is a GIF, its first and last time, and its number of frames.
    fn plan(&self, path: &Path, [begin, end]: [f64; 2]) -> Result<(bool, [f64; 2], f64)> {
        let refuse = |reason: String| Err(Error::Write { path: path.to_path_buf(), reason });
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
        let is_gif = match ending.as_deref() {
            Some("gif") => true,
            Some("mp4") => false,
            _ => return refuse("allowed: a name that ends in .gif or .mp4".to_string()),
        };
        if begin.partial_cmp(&end) != Some(Ordering::Less) {
            return refuse("a film needs a run of more than one time".to_string());
        }
        let [from, until] = self.window;
        let (first, last) = (begin.max(from), end.min(until));
        if from.is_nan() || until.is_nan() || first.partial_cmp(&last) != Some(Ordering::Less) {
            return refuse(format!("found {from} to {until} s; allowed: a part of the run, {begin} to {end} s"));
        }
        if !SHARPNESS.contains(&self.sharpness) {
            let (least, most) = (SHARPNESS.start(), SHARPNESS.end());
            return refuse(format!("found a sharpness of {}; allowed: {least} to {most}", self.sharpness));
        }
        let count = ((last - first) / self.speed * f64::from(self.per_second)).round().max(2.0);
        if !(count <= MAX_FRAMES && self.per_second > 0 && self.speed > 0.0) {
            let found = format!("{} pictures per second at {} times the speed", self.per_second, self.speed);
            return refuse(format!("found {found}; allowed: positive numbers, and at most {MAX_FRAMES} pictures"));
        }
        if is_gif && self.per_second > MAX_GIF_RATE {
            let found = format!("{} pictures per second", self.per_second);
            return refuse(format!("found {found}; allowed: at most {MAX_GIF_RATE} in a GIF"));
        }
        Ok((is_gif, [first, last], count))
    }

    /// Writes a film to `path`, which ends in .gif or .mp4. `watch` is called before each frame with the completed fraction, and
    /// may stop it. A file of that name is replaced by a complete film only.
    ///
    /// # Errors
    /// Those of [`check`](Self::check); [`Error::Write`] for no ffmpeg for an MP4, or a full disk; [`Error::Interrupted`] where `watch`
    /// stops it.
    pub fn write(
        &self,
        path: &Path,
        motion: &RodMotion<'_>,
        mut watch: impl FnMut(f64) -> ControlFlow<()>,
    ) -> Result<()> {
        let run = [motion.times.first(), motion.times.last()].map(|time| time.copied().unwrap_or(f64::NAN));
        let (is_gif, [first, last], count) = self.plan(path, run)?;
        let refuse = |reason: String| Error::Write { path: path.to_path_buf(), reason };
        let (painter, corners) = (SvgRenderer::new(), motion.corners([first, last]));
        let draw = |n: f64| {
            let time = first + (last - first) * n / (count - 1.0);
            painter.pixels(&motion.svg(time, &corners), self.sharpness).map_err(refuse)
        };
        let mut frames = (0..count as usize).map(|n| n as f64).map(|n| match watch(n / count) {
            ControlFlow::Continue(()) => draw(n),
            ControlFlow::Break(()) => Err(Error::Interrupted),
        });
        write_atomically(path, |file| match is_gif {
            true => self.gif(path, file.path(), &mut frames),
            false => self.mp4(path, file.path(), &mut frames),
        })
    }

    fn gif(&self, path: &Path, file: &Path, frames: Frames<'_>) -> Result<()> {
        let failed = |error: gif::EncodingError| Error::Write { path: path.to_path_buf(), reason: error.to_string() };
        let mut encoder = None;
        // Delays are whole hundredths of a second; each ends where it should, so that their rounding does not add up.
        let end = |n: usize| (100.0 * n as f64 / f64::from(self.per_second)).round();
        for (n, pixels) in frames.enumerate() {
            let pixels = pixels?;
            let (width, height) = (pixels.width() as u16, pixels.height() as u16);
            if encoder.is_none() {
                let out = BufWriter::new(File::create(file).map_err(|error| write_error(path, &error))?);
                let mut new = Encoder::new(out, width, height, &[]).map_err(failed)?;
                new.set_repeat(Repeat::Infinite).map_err(failed)?;
                encoder = Some(new);
            }
            let mut frame = Frame::from_rgba_speed(width, height, &mut pixels.take(), 20);
            frame.delay = (end(n + 1) - end(n)) as u16;
            encoder.iter_mut().try_for_each(|encoder| encoder.write_frame(&frame)).map_err(failed)?;
        }
        // Where they are dropped, the error of the last bytes is lost.
        let out = encoder.map(|encoder| encoder.into_inner().map_err(failed)).transpose()?;
        out.map_or(Ok(()), |mut out| out.flush()).map_err(|error| write_error(path, &error))
    }

    fn mp4(&self, path: &Path, file: &Path, frames: Frames<'_>) -> Result<()> {
        let refuse = |reason: Cow<'_, str>| Error::Write { path: path.to_path_buf(), reason: reason.into_owned() };
        let mut ffmpeg: Option<Child> = None;
        for pixels in frames {
            let pixels = pixels.inspect_err(|_| {
                if let Some(ffmpeg) = &mut ffmpeg {
                    let _ = ffmpeg.kill().and_then(|()| ffmpeg.wait()); // the film is given up
                }
            })?;
            if ffmpeg.is_none() {
                let size = format!("{}x{}", pixels.width(), pixels.height());
                let child = Command::new("ffmpeg")
                    .args(["-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgba", "-s", &size])
                    .args(["-r", &self.per_second.to_string(), "-i", "-"])
                    // Most players want even sides and this kind of colours.
                    .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p"])
                    .args(["-movflags", "+faststart", "-f", "mp4"])
                    .arg(file)
                    .stdin(Stdio::piped())
                    .stdout(Stdio::null())
                    .stderr(Stdio::piped())
                    .spawn();
                let missing = "it needs the program ffmpeg, which is not installed; a .gif needs none";
                ffmpeg = Some(child.map_err(|error| match error.kind() {
                    std::io::ErrorKind::NotFound => refuse(missing.into()),
                    _ => refuse(format!("ffmpeg: {error}").into()),
                })?);
            }
            let input = ffmpeg.as_mut().and_then(|ffmpeg| ffmpeg.stdin.as_mut());
            // What is wrong ffmpeg says at its end.
            if input.is_some_and(|input| input.write_all(pixels.data()).is_err()) {
                break;
            }
        }
        let Some(ffmpeg) = ffmpeg else { return Ok(()) };
        let end = ffmpeg.wait_with_output().map_err(|error| write_error(path, &error))?;
        match end.status.success() {
            true => Ok(()),
            false => Err(refuse(format!("ffmpeg: {}", String::from_utf8_lossy(&end.stderr).trim()).into())),
        }
    }
}

type Frames<'a> = &'a mut dyn Iterator<Item = Result<resvg::tiny_skia::Pixmap>>;

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]

    use super::*;

    const MOTION: RodMotion<'_> = RodMotion {
        name: "rod",
        times: &[0.0, 1.0],
        x: &[0.0, 0.5, 1.0, 0.0, 0.5, 1.0],
        y: &[0.0, 0.1, 0.0, 0.0, 0.2, 0.1],
    };

    #[test]
    fn a_film_that_is_stopped_leaves_the_earlier_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rod.gif");
        let settings = FilmSettings { per_second: 5, ..FilmSettings::default() };
        settings.write(&path, &MOTION, |_| ControlFlow::Continue(())).unwrap();
        let whole = std::fs::read(&path).unwrap();
        assert_eq!(whole.last(), Some(&b';'), "a GIF ends with its trailer");
        for stop in [0.0, 0.5] {
            let watch = |part: f64| if part >= stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
            assert_eq!(settings.write(&path, &MOTION, watch), Err(Error::Interrupted));
            assert_eq!(std::fs::read(&path).unwrap(), whole);
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_sharpness_or_a_window_that_is_no_number_is_refused() {
        let refused =
            |settings: FilmSettings| settings.check(Path::new("rod.gif"), [0.0, 1.0]).unwrap_err().to_string();
        for sharpness in [f64::NAN, 0.0, -1.0, 1e9] {
            let said = refused(FilmSettings { sharpness, ..FilmSettings::default() });
            assert!(said.contains(&format!("found a sharpness of {sharpness}; allowed: 0.05 to 20")), "{said}");
        }
        for window in [[f64::NAN, 1.0], [0.0, f64::NAN]] {
            let said = refused(FilmSettings { window, ..FilmSettings::default() });
            assert!(said.contains("allowed: a part of the run, 0 to 1 s"), "{said}");
        }
    }
}
