//! Films of a moving rod: animated SVG, GIF, or MP4 by ffmpeg.

use std::cmp::Ordering;
use std::collections::VecDeque;
use std::fmt;
use std::fs::File;
use std::io::{BufWriter, Read, Write};
use std::ops::{ControlFlow, RangeInclusive};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use gif::{Encoder, Extension, Repeat};
use nalgebra::Vector2;

pub use super::film_scene::FilmedMotion;
use super::film_scene::{FilmScene, MARK, round_below};
use super::folder::{Claim, Folder};
use super::frame::Frame;
use super::picture::SvgRenderer;
use super::rod_motion::{DrawnRod, RodMotion};
use super::run_record::{RecordingTimes, Thinned};
use super::sampling::{LEAST_PER_PERIOD, digits_of, fastest_drive};
use crate::error::{Error, Result};
use crate::files::{write_atomically, write_error, write_file};
use crate::number_format::in_sentence;
use crate::scene::Scene;
use crate::stepper::Stepper;
use crate::wording::Phrase;

/// Settings of a film.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilmSettings {
    /// Frames per second of a GIF or an MP4, [`PER_SECOND`] if absent; an SVG has none.
    pub per_second: Option<u32>,
    /// Seconds of the run per second of the film; if absent, a speed at which the motion is easy to see.
    pub speed: Option<f64>,
    /// Pixels per px of the figure.
    pub sharpness: f64,
    /// First and last time that it shows, s, limited to those of the run. By default it shows the last cycle of a motion that repeats, and
    /// of another one all of it, or as many of its last periods as a film has room for.
    pub window: [f64; 2],
    /// Whether it replaces a file that caudal did not write.
    pub claim: Claim,
}

impl Default for FilmSettings {
    fn default() -> Self {
        let window = [f64::NEG_INFINITY, f64::INFINITY];
        Self { per_second: None, speed: None, sharpness: 1.0, window, claim: Claim::Own }
    }
}

/// Frames per second of a GIF or an MP4 by default.
pub const PER_SECOND: u32 = 25;

/// Most frames of a film whose part of the run is not chosen.
const MAX_FRAMES_BY_DEFAULT: f64 = 600.0;

/// Keyframes of an SVG: of one cycle, least and most of another motion, and least of each of its cycles. What is between them is
/// interpolated.
const KEYFRAMES_OF_CYCLE: f64 = 33.0;
const KEYFRAMES: [f64; 2] = [25.0, 301.0];
const KEYFRAMES_PER_CYCLE: f64 = 12.0;

/// Keyframes of an SVG per second, unless its motion has cycles.
const KEYFRAMES_PER_SECOND: f64 = 15.0;

/// Least and largest duration of a cycle in a film of up to so many of them, s, and of a part of one. Faster cycles are slowed down to the
/// least, so that of two films that of the faster beat never looks slower.
const SECONDS_OF_CYCLE: [f64; 2] = [1.0, 4.0];
const FEW_CYCLES: f64 = 5.0;

/// Preferred duration of the film of a whole run, s.
const SECONDS_OF_RUN: f64 = 8.0;

/// A motion is shown at its own speed if that takes between these factors of the best time.
const REAL_TIME: [f64; 2] = [0.25, 2.5];

/// Largest speed of the fluid, px per second of an SVG: faster specks are not seen to move.
const MAX_PACE: f64 = 600.0;

/// Number of pictures that are sampled to find the extent of a motion.
const LOOKS: usize = 120;

/// A motion closes if its shapes at both ends are no further apart than this part of the largest distance in between.
const CLOSED: f64 = 0.05;

/// Rows from the last that are searched for the same shape.
const MAX_ROWS_BACK: usize = 4000;

/// The mark of a film is within so many bytes from its beginning.
const MAX_BYTES_TO_MARK: u64 = 4 << 20;

/// The kinds of films.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FilmFormat {
    Svg,
    Gif,
    Mp4,
}

impl FilmFormat {
    /// The format of a file with this name.
    fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_string_lossy().to_lowercase().as_str() {
            "svg" => Some(Self::Svg),
            "gif" => Some(Self::Gif),
            "mp4" => Some(Self::Mp4),
            _ => None,
        }
    }

    /// Most pictures of a film. Those of an SVG are its keyframes.
    fn most_pictures(self) -> f64 {
        match self {
            Self::Svg => KEYFRAMES[1],
            Self::Gif => 3000.0,
            Self::Mp4 => 100_000.0,
        }
    }
}

/// A checked film.
#[derive(Debug, Clone, Copy)]
struct FilmPlan {
    format: FilmFormat,
    /// First and last time of what is shown at most, s.
    window: [f64; 2],
    /// True if that was chosen, so that all of it is shown.
    is_chosen: bool,
}

/// What a film shows of a motion, how fast, and in how many pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FilmExcerpt {
    /// First and last time, s.
    pub window: [f64; 2],
    /// Number of pictures; of an SVG, its keyframes.
    pub pictures: usize,
    part: FilmedPart,
    /// Seconds of the run per second of the film.
    speed: f64,
    /// True if the motion repeats, so that its last shape is its first one.
    closes: bool,
}

/// The part of a motion that a film shows.
#[derive(Debug, Clone, Copy, PartialEq)]
enum FilmedPart {
    Chosen,
    Cycle,
    Whole,
    /// So many of the last periods of the fastest drive, since all of the motion would have so many pictures.
    LastPeriods {
        count: f64,
        of_whole: f64,
    },
}

impl FilmedPart {
    /// The duration (s) of last periods of this frequency (Hz), which does not have the rounding of their first and last time.
    fn span(self, frequency: f64) -> Option<f64> {
        match self {
            Self::LastPeriods { count, .. } => Some(count / frequency),
            Self::Chosen | Self::Cycle | Self::Whole => None,
        }
    }
}

impl fmt::Display for FilmExcerpt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [from, until] = self.window.map(|time| in_sentence(time, digits_of(self.window)));
        match self.part {
            FilmedPart::Chosen => {}
            FilmedPart::Cycle => f.write_str("the last cycle, ")?,
            FilmedPart::Whole => f.write_str("the whole run, ")?,
            FilmedPart::LastPeriods { count: 1.0, .. } => f.write_str("the last period, ")?,
            FilmedPart::LastPeriods { count, .. } => write!(f, "the last {count} periods, ")?,
        }
        write!(f, "from t = {from} s to {until} s, {}", pace_in_words(self.speed))?;
        if let FilmedPart::LastPeriods { of_whole, .. } = self.part {
            write!(f, "; the whole run would have {of_whole:.0} pictures: {}", Phrase::FilmWindow)?;
        }
        Ok(())
    }
}

/// Most frames per second of a GIF: its delays are hundredths of a second, and many viewers take a delay of one for ten.
const MAX_GIF_RATE: u32 = 50;

/// Allowed pixels per px of the figure, which is some hundreds of px wide.
const SHARPNESS: RangeInclusive<f64> = 0.05..=20.0;

impl FilmSettings {
    /// Checks a film of a run from the first to the last of these times (s), with this fastest drive (Hz), that is to be written to `path`.
    ///
    /// # Errors
    /// [`Error::Write`] for an extension other than .svg, .gif and .mp4, a run of one time, a window outside the run, a
    /// sharpness that is out of range, rates that are not positive or too large, frames per second of an SVG, too many pictures, an MP4
    /// without ffmpeg, and a file that caudal did not write, unless the claim is forced; [`Error::Occupied`] for a result.
    pub fn check(&self, path: &Path, run: [f64; 2], drive: Option<f64>) -> Result<()> {
        let FilmPlan { format, window: [first, last], is_chosen } = self.plan(path, run)?;
        if format == FilmFormat::Mp4 {
            find_ffmpeg(path)?;
        }
        let span = last - first;
        let shown = match (is_chosen, drive) {
            (true, _) => span,
            (false, Some(frequency)) => self.part(format, span, drive, f64::INFINITY).span(frequency).unwrap_or(span),
            (false, None) => return Ok(()), // it may have a cycle
        };
        self.admit_pictures(path, format, self.pictures_of(format, shown, drive))
    }

    /// What is to be said of such a film: that it has too few pictures per period of the drive.
    pub fn warning(&self, path: &Path, drive: Option<f64>) -> Option<String> {
        let frequency = drive.filter(|_| FilmFormat::of(path) != Some(FilmFormat::Svg))?;
        let rate = self.rate() / (self.speed? * frequency);
        (rate < LEAST_PER_PERIOD * (1.0 - 1e-9)).then(|| {
            format!(
                "{} has {} pictures per period of the fastest drive; with fewer than {LEAST_PER_PERIOD} the beat may look slower than it \
                 is, or go backwards; --speed {} has enough",
                path.display(),
                in_sentence(rate, 2),
                in_sentence(round_below(self.largest_speed(frequency)), 3)
            )
        })
    }

    /// Frames per second.
    fn rate(&self) -> f64 {
        f64::from(self.per_second.unwrap_or(PER_SECOND))
    }

    /// The largest speed of a film with enough pictures per period of a drive (Hz).
    fn largest_speed(&self, frequency: f64) -> f64 {
        self.rate() / (LEAST_PER_PERIOD * frequency)
    }

    /// The speed of a film of this span (s), of a motion with this frequency (Hz), unless it is given.
    fn speed_of(&self, span: f64, frequency: Option<f64>) -> f64 {
        let easy = || {
            let easy = usual_speed(span, frequency.map(f64::recip));
            match frequency.map(|frequency| self.largest_speed(frequency)) {
                Some(largest) if easy > largest && largest > 0.0 => round_below(largest),
                _ => easy,
            }
        };
        self.speed.unwrap_or_else(easy)
    }

    /// The part of a motion of this `span` (s) and frequency (Hz) that is shown if none is chosen and the motion has no cycle: all of it,
    /// or as many of its last periods as there is room for, at least one and at most so many as are densely recorded.
    fn part(&self, format: FilmFormat, span: f64, frequency: Option<f64>, recorded: f64) -> FilmedPart {
        let of_whole = self.pictures_of(format, span, frequency);
        let most = format.most_pictures().min(MAX_FRAMES_BY_DEFAULT);
        match frequency.map(|frequency| periods_in(span, frequency)).filter(|periods| *periods >= 1.0) {
            Some(periods) if of_whole > most => {
                let count = (most / of_whole * periods).min(recorded).floor().max(1.0);
                FilmedPart::LastPeriods { count, of_whole }
            }
            _ => FilmedPart::Whole,
        }
    }

    /// The number of pictures of a film of this span (s) of a motion with this frequency (Hz).
    fn pictures_of(&self, format: FilmFormat, span: f64, frequency: Option<f64>) -> f64 {
        self.pictures(format, span, self.speed_of(span, frequency), frequency)
    }

    /// The same at this speed.
    fn pictures(&self, format: FilmFormat, span: f64, speed: f64, frequency: Option<f64>) -> f64 {
        match format {
            FilmFormat::Svg => {
                let [least, most] = KEYFRAMES;
                let periods = frequency.map_or(0.0, |frequency| periods_in(span, frequency));
                let wanted = KEYFRAMES_PER_CYCLE * periods + 1.0;
                wanted.ceil().max((KEYFRAMES_PER_SECOND * span / speed).clamp(least, most).round())
            }
            FilmFormat::Gif | FilmFormat::Mp4 => (span / speed * self.rate()).round().max(2.0),
        }
    }

    fn admit_pictures(&self, path: &Path, format: FilmFormat, pictures: f64) -> Result<()> {
        let most = format.most_pictures();
        if pictures <= most {
            return Ok(());
        }
        let (found, window) = (format!("found {pictures:.0} pictures"), Phrase::FilmWindow);
        let fewer = Phrase::FewerPictures;
        let reason = match format {
            FilmFormat::Svg => {
                format!("{found}, {KEYFRAMES_PER_CYCLE} per cycle; allowed in an SVG: {most}; {window}")
            }
            FilmFormat::Gif => format!("{found}; allowed in a GIF: {most}; {window}, or {fewer}"),
            FilmFormat::Mp4 => format!("{found}; allowed in an MP4: {most}; {window}, or {fewer}"),
        };
        Err(Error::Write { path: path.to_path_buf(), reason })
    }

    fn plan(&self, path: &Path, [begin, end]: [f64; 2]) -> Result<FilmPlan> {
        let refuse = |reason: String| Err(Error::Write { path: path.to_path_buf(), reason });
        let Some(format) = FilmFormat::of(path) else {
            return refuse("allowed: a name that ends in .svg, .gif or .mp4".to_string());
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
        if let Some(speed) = self.speed.filter(|speed| !(*speed > 0.0 && speed.is_finite())) {
            return refuse(format!("found {speed} times the speed; allowed: a positive number"));
        }
        match (format, self.per_second) {
            (FilmFormat::Svg, Some(found)) => {
                return refuse(format!(
                    "found {found} pictures per second; allowed of a .gif or .mp4 alone: an SVG is animated as smoothly as the screen shows it"
                ));
            }
            (_, Some(0)) => return refuse("found 0 pictures per second; allowed: a positive number".to_string()),
            (FilmFormat::Gif, Some(found)) if found > MAX_GIF_RATE => {
                return refuse(format!("found {found} pictures per second; allowed: at most {MAX_GIF_RATE} in a GIF"));
            }
            _ => {}
        }
        self.admit(path)?;
        Ok(FilmPlan { format, window: [first, last], is_chosen: self.window != Self::default().window })
    }

    /// Refuses the name of a result, and unless the claim is forced that of a file that caudal did not write.
    fn admit(&self, path: &Path) -> Result<()> {
        if let Some(holds) = Folder::result_at(path) {
            return Err(Error::Occupied { path: path.to_path_buf(), holds, wanted: "a film".to_string(), kept: true });
        }
        let is_there = std::fs::metadata(path).is_ok_and(|file| file.is_file() && file.len() > 0);
        if self.claim == Claim::Force || !is_there || is_marked(path) {
            return Ok(());
        }
        let reason = format!("there is a file that caudal did not write; choose another name, or {}", Phrase::Replace);
        Err(Error::Write { path: path.to_path_buf(), reason })
    }

    /// What a film of `motion` that is written to `path` shows of it: what is chosen; otherwise the last cycle, if the motion repeats; otherwise
    /// all of it, or its last periods. Of a cycle or of last periods all is densely recorded.
    ///
    /// # Errors
    /// Those of [`check`](Self::check).
    pub fn excerpt(&self, path: &Path, motion: &FilmedMotion<'_>) -> Result<FilmExcerpt> {
        let run = [motion.times().next(), motion.times().next_back()].map(|time| time.unwrap_or(f64::NAN));
        let FilmPlan { format, window, is_chosen } = self.plan(path, run)?;
        // The cycle of a drive is known, and a motion of incommensurable drives has none.
        let returns = if motion.drive.is_none() { motion.cycle.or_else(|| last_return(motion)) } else { motion.cycle };
        let dense = densely_recorded_since(motion, motion.drive);
        let is_dense = |[from, until]: &[f64; 2]| until > from && *from >= dense - SAME_TIME * (until - from);
        let cycle = returns.filter(is_dense).filter(|cycle| !is_chosen && closes(motion, *cycle));
        // Of several frequencies the fastest one counts: what is between two pictures is not seen, or interpolated.
        let frequency = motion.drive.or_else(|| motion.cycle.or(cycle).map(|[from, until]| (until - from).recip()));
        let excerpt = |part: FilmedPart, window: [f64; 2]| {
            let span = frequency.and_then(|frequency| part.span(frequency)).unwrap_or(window[1] - window[0]);
            let closes = part == FilmedPart::Cycle || closes(motion, window);
            let mut speed = self.speed_of(span, frequency);
            if format == FilmFormat::Svg && self.speed.is_none() {
                let pace = FilmScene::of(*motion, window, LOOKS, closes).pace();
                speed = if pace * speed > MAX_PACE { round_below(MAX_PACE / pace) } else { speed };
            }
            let pictures = match (format, part) {
                // However slowly it is shown.
                (FilmFormat::Svg, FilmedPart::Cycle) => {
                    self.pictures(format, span, f64::INFINITY, frequency).max(KEYFRAMES_OF_CYCLE)
                }
                _ => self.pictures(format, span, speed, frequency),
            };
            FilmExcerpt { window, pictures: pictures as usize, part, speed, closes }
        };
        let most = format.most_pictures();
        if is_chosen {
            let chosen = excerpt(FilmedPart::Chosen, window);
            return self.admit_pictures(path, format, chosen.pictures as f64).map(|()| chosen);
        }
        let cycle = cycle.map(|cycle| excerpt(FilmedPart::Cycle, cycle));
        if let Some(cycle) = cycle.filter(|cycle| cycle.pictures as f64 <= most) {
            return Ok(cycle);
        }
        let [first, last] = window;
        let recorded = frequency.map_or(0.0, |frequency| periods_in(last - dense, frequency));
        let part = self.part(format, last - first, frequency, recorded);
        let from = frequency.and_then(|frequency| part.span(frequency)).map_or(first, |span| last - span);
        let shown = excerpt(part, [from, last]);
        self.admit_pictures(path, format, shown.pictures as f64).map(|()| shown)
    }

    /// Writes a film to `path`, which ends in .svg, .gif or .mp4, of an [`excerpt`](Self::excerpt) of a motion. `watch` is called before each
    /// frame with the completed fraction, and may stop it. A file of that name is replaced by a complete film only.
    ///
    /// # Errors
    /// Those of [`check`](Self::check); [`Error::Write`] for no ffmpeg for an MP4, or a full disk; [`Error::Interrupted`] where `watch`
    /// stops it.
    pub fn write(
        &self,
        path: &Path,
        motion: &FilmedMotion<'_>,
        excerpt: &FilmExcerpt,
        mut watch: impl FnMut(f64) -> ControlFlow<()>,
    ) -> Result<()> {
        let FilmExcerpt { window: [first, last], pictures, speed, closes, .. } = *excerpt;
        let FilmPlan { format, .. } = self.plan(path, [first, last])?;
        let scene = FilmScene::of(*motion, [first, last], LOOKS, closes);
        if format == FilmFormat::Svg {
            let pace = pace_in_words(speed);
            let [from, until] = [first, last].map(|time| in_sentence(time, digits_of([first, last])));
            let title = format!("{} from t = {from} s to {until} s, {pace}", motion.name);
            return match watch(0.0) {
                ControlFlow::Continue(()) => {
                    write_file(path, scene.animated((last - first) / speed, pictures, &pace, &title))
                }
                ControlFlow::Break(()) => Err(Error::Interrupted),
            };
        }
        // A film whose last shape is its first one loops without a jump: the picture after the last one would be the first one.
        let (painter, scene) = (SvgRenderer::new(), if closes { scene.looping() } else { scene });
        let count = pictures as f64;
        let steps = if closes { count } else { count - 1.0 };
        let pace = if (speed - 1.0).abs() < 1e-9 { String::new() } else { format!(", {}", pace_in_words(speed)) };
        // Rounded to a hundredth of the window, but not coarser than a hundredth of a second.
        let decimals = (2.0 - (last - first).log10().floor()).clamp(2.0, 9.0) as usize;
        let draw = |n: f64| {
            let time = first + (last - first) * n / steps;
            let picture = scene.picture(time, &format!("{}, t = {time:.decimals$} s{pace}", motion.name));
            painter.pixels(&picture, self.sharpness).map_err(|reason| Error::Write { path: path.to_path_buf(), reason })
        };
        let mut frames = (0..pictures).map(|n| n as f64).map(|n| match watch(n / count) {
            ControlFlow::Continue(()) => draw(n),
            ControlFlow::Break(()) => Err(Error::Interrupted),
        });
        write_atomically(path, |file| match format {
            FilmFormat::Mp4 => self.mp4(path, file.path(), &mut frames),
            _ => self.gif(path, file.path(), &mut frames),
        })
    }

    fn gif(&self, path: &Path, file: &Path, frames: Frames<'_>) -> Result<()> {
        let failed = |error: gif::EncodingError| Error::Write { path: path.to_path_buf(), reason: error.to_string() };
        let mut encoder = None;
        // Delays are whole hundredths of a second; each ends where it should, so that their rounding does not add up.
        let end = |n: usize| (100.0 * n as f64 / self.rate()).round();
        for (n, pixels) in frames.enumerate() {
            let pixels = pixels?;
            let (width, height) = (pixels.width() as u16, pixels.height() as u16);
            if encoder.is_none() {
                let out = BufWriter::new(File::create(file).map_err(|error| write_error(path, &error))?);
                let mut new = Encoder::new(out, width, height, &[]).map_err(failed)?;
                new.set_repeat(Repeat::Infinite).map_err(failed)?;
                new.write_raw_extension(Extension::Comment.into(), &[MARK.as_bytes()]).map_err(failed)?;
                encoder = Some(new);
            }
            let mut frame = gif::Frame::from_rgba_speed(width, height, &mut pixels.take(), 20);
            frame.delay = (end(n + 1) - end(n)) as u16;
            encoder.iter_mut().try_for_each(|encoder| encoder.write_frame(&frame)).map_err(failed)?;
        }
        // Where they are dropped, the error of the last bytes is lost.
        let out = encoder.map(|encoder| encoder.into_inner().map_err(failed)).transpose()?;
        out.map_or(Ok(()), |mut out| out.flush()).map_err(|error| write_error(path, &error))
    }

    fn mp4(&self, path: &Path, file: &Path, frames: Frames<'_>) -> Result<()> {
        let mut ffmpeg: Option<Child> = None;
        for pixels in frames {
            let pixels = pixels.inspect_err(|_| {
                if let Some(ffmpeg) = &mut ffmpeg {
                    let _ = ffmpeg.kill().and_then(|()| ffmpeg.wait()); // the film is abandoned
                }
            })?;
            if ffmpeg.is_none() {
                let size = format!("{}x{}", pixels.width(), pixels.height());
                let child = Command::new("ffmpeg")
                    .args(["-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgba", "-s", &size])
                    .args(["-r", &self.rate().to_string(), "-i", "-"])
                    // Most players require even sides and this pixel format.
                    .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p"])
                    .args(["-metadata", &format!("comment={MARK}"), "-movflags", "+faststart", "-f", "mp4"])
                    .arg(file)
                    .stdin(Stdio::piped())
                    .stdout(Stdio::null())
                    .stderr(Stdio::piped())
                    .spawn();
                ffmpeg = Some(child.map_err(|error| no_ffmpeg(path, &error))?);
            }
            let input = ffmpeg.as_mut().and_then(|ffmpeg| ffmpeg.stdin.as_mut());
            // ffmpeg prints its error at the end.
            if input.is_some_and(|input| input.write_all(pixels.data()).is_err()) {
                break;
            }
        }
        let Some(ffmpeg) = ffmpeg else { return Ok(()) };
        let end = ffmpeg.wait_with_output().map_err(|error| write_error(path, &error))?;
        match end.status.success() {
            true => Ok(()),
            false => {
                let reason = format!("ffmpeg: {}", String::from_utf8_lossy(&end.stderr).trim());
                Err(Error::Write { path: path.to_path_buf(), reason })
            }
        }
    }
}

/// Refuses an MP4 at `path` if there is no program ffmpeg.
fn find_ffmpeg(path: &Path) -> Result<()> {
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    ffmpeg.status().map(drop).map_err(|error| no_ffmpeg(path, &error))
}

/// The error of an MP4 at `path` for which ffmpeg did not start.
fn no_ffmpeg(path: &Path, error: &std::io::Error) -> Error {
    let reason = match error.kind() {
        std::io::ErrorKind::NotFound => {
            "it needs the program ffmpeg, which is not installed; a .gif needs none".to_string()
        }
        _ => format!("ffmpeg: {error}"),
    };
    Error::Write { path: path.to_path_buf(), reason }
}

/// The number of periods of this frequency (Hz) in a span (s), whole where only rounding makes the difference.
fn periods_in(span: f64, frequency: f64) -> f64 {
    let periods = span * frequency;
    if (periods - periods.round()).abs() <= PERIOD_TOLERANCE { periods.round() } else { periods }
}

/// True if the file at `path` is a film by caudal.
fn is_marked(path: &Path) -> bool {
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(MAX_BYTES_TO_MARK).read_to_end(&mut bytes));
    read.is_ok() && bytes.windows(MARK.len()).any(|part| part == MARK.as_bytes())
}

/// The speed at which a motion of `span` (s) with this `period` (s) is easy to see: few cycles by the duration of each, others by that of all.
fn usual_speed(span: f64, period: Option<f64>) -> f64 {
    let [least, most] = SECONDS_OF_CYCLE;
    match period.filter(|period| span <= FEW_CYCLES * period * (1.0 + 1e-9)) {
        Some(period) => {
            let shown = period.min(span);
            shown / shown.clamp(least, most)
        }
        None => easy_speed(span / SECONDS_OF_RUN),
    }
}

/// A speed, as a film says it.
fn pace_in_words(speed: f64) -> String {
    match speed {
        _ if (speed - 1.0).abs() < 1e-9 => "real time".to_string(),
        _ if speed < 1.0 => format!("{} times slower", in_sentence(speed.recip(), 3)),
        _ => format!("{} times faster", in_sentence(speed, 3)),
    }
}

/// The motion of a run for one film: what the film draws, whatever the length of the run.
#[derive(Debug)]
pub struct FilmRecord {
    rod: DrawnRod,
    samples: Samples,
}

#[derive(Debug)]
enum Samples {
    /// So many equidistant times from the first, and the last, s.
    Even { first: f64, last: f64, intervals: u64, next: u64, frames: Vec<Frame> },
    /// Frames all over the run, and densely those of the end of the run, in which the last cycle is.
    WithLastCycle { times: RecordingTimes, tick: u64, whole: Thinned<Frame>, recent: VecDeque<Frame> },
}

/// Most frames that a record has of the whole run, and of its end, for a film that may be of its last cycle.
const MAX_RECORDED: usize = 2400;

/// Frames of such a record per period of the drive.
const RECORDED_PER_PERIOD: f64 = 48.0;

/// Two times closer than this part of an interval are equal.
const SAME_TIME: f64 = 1e-9;

/// Numbers of periods that differ by less are equal.
const PERIOD_TOLERANCE: f64 = 1e-6;

/// Relative rounding of the time between two frames.
const SPACING_TOLERANCE: f64 = 1e-3;

impl FilmRecord {
    /// Starts with the current state of a run of `scene` until time `end` (s), for a film with these `settings` that is to be written to
    /// `path`.
    ///
    /// # Errors
    /// Those of [`FilmSettings::check`] and of [`Stepper::at`].
    pub fn start(settings: &FilmSettings, path: &Path, scene: &Scene, stepper: &mut Stepper, end: f64) -> Result<Self> {
        let drive = fastest_drive(scene, stepper.model());
        let FilmPlan { format, window: [first, last], is_chosen } = settings.plan(path, [stepper.time(), end])?;
        let span = last - first;
        let even = |intervals: u64| Samples::Even { first, last, intervals, next: 0, frames: Vec::new() };
        let samples = match (is_chosen, format) {
            (true, FilmFormat::Svg) => even(MAX_RECORDED as u64),
            // Those of a film that loops; another one has hardly other times.
            (true, _) => even(settings.pictures(format, span, settings.speed_of(span, drive), drive) as u64),
            (false, _) => {
                let spacing = match drive {
                    Some(frequency) => RecordingTimes::Every(1.0 / (RECORDED_PER_PERIOD * frequency), 1),
                    None => RecordingTimes::sampled(stepper.step_control(), span / MAX_RECORDED as f64),
                };
                let (whole, recent) = (Thinned::new(MAX_RECORDED), VecDeque::new());
                Samples::WithLastCycle { times: spacing, tick: 0, whole, recent }
            }
        };
        let mut record = Self { rod: DrawnRod::of(stepper.model()), samples };
        match &mut record.samples {
            Samples::Even { .. } => record.step(stepper)?,
            Samples::WithLastCycle { whole, recent, .. } => {
                let frame = Frame::of(&stepper.view(), record.rod.nodes());
                recent.push_back(frame.clone());
                whole.offer(0, || frame);
            }
        }
        Ok(record)
    }

    /// Records the last step.
    ///
    /// # Errors
    /// Those of [`Stepper::at`].
    pub fn step(&mut self, stepper: &mut Stepper) -> Result<()> {
        let nodes = self.rod.nodes();
        match &mut self.samples {
            Samples::Even { first, last, intervals, next, frames } => {
                let spacing = (*last - *first) / *intervals as f64;
                while *next <= *intervals {
                    let (time, now) = (*first + *next as f64 * spacing, stepper.time());
                    let is_now = (time - now).abs() <= SAME_TIME * spacing + 4.0 * f64::EPSILON * now.abs();
                    if time > now && !is_now {
                        break;
                    }
                    frames.push(stepper.at(if is_now { now } else { time }, |view| Frame::of(view, nodes))?);
                    *next += 1;
                }
                Ok(())
            }
            Samples::WithLastCycle { times, tick, whole, recent } => {
                let outcome = times.pass(stepper, |view, _| {
                    *tick += 1;
                    let frame = Frame::of(view, nodes);
                    whole.offer(*tick, || frame.clone());
                    if recent.len() == MAX_RECORDED {
                        recent.pop_front();
                    }
                    recent.push_back(frame);
                    Ok(ControlFlow::Continue(()))
                });
                outcome.map(drop)
            }
        }
    }

    /// The motion, up to the final state.
    pub fn finish(self, stepper: &Stepper) -> RodMotion {
        let Self { rod, samples } = self;
        let (mut frames, until) = match samples {
            Samples::Even { frames, last, .. } => (frames, last),
            Samples::WithLastCycle { whole, recent, .. } => {
                let since = recent.front().map_or(f64::INFINITY, |frame| frame.time);
                let before = whole.kept.into_iter().take_while(|frame| frame.time < since);
                (before.chain(recent).collect(), f64::INFINITY)
            }
        };
        let now = stepper.time();
        if now < until && frames.last().is_some_and(|frame| frame.time < now) {
            frames.push(Frame::of(&stepper.view(), rod.nodes()));
        }
        RodMotion::whole(rod, frames)
    }
}

/// How each node moves from one time to another, m: wherever the rod travels, unless the camera stays where it is.
fn change_of_shape(motion: &FilmedMotion<'_>, times: [f64; 2]) -> Vec<Vector2<f64>> {
    let [one, other] = times.map(|time| motion.at(time));
    let travel = match motion.can_be_followed() {
        true => one.iter().zip(&other).map(|(a, b)| b - a).sum::<Vector2<f64>>() / one.len().max(1) as f64,
        false => Vector2::zeros(),
    };
    one.iter().zip(&other).map(|(a, b)| b - a - travel).collect()
}

/// The largest of these, m.
fn largest(changes: impl IntoIterator<Item = Vector2<f64>>) -> f64 {
    changes.into_iter().map(|change| change.norm()).fold(0.0, f64::max)
}

/// How far the shapes of the rod at two times are apart, the largest distance of a node, m.
fn shape_distance(motion: &FilmedMotion<'_>, times: [f64; 2]) -> f64 {
    largest(change_of_shape(motion, times))
}

/// True if the rod has the same shape at both ends of the window (s), measured by how it changes in between.
fn closes(motion: &FilmedMotion<'_>, [from, until]: [f64; 2]) -> bool {
    let at = |n: usize| from + (until - from) * n as f64 / LOOKS as f64;
    let most = (1..LOOKS).map(|n| shape_distance(motion, [from, at(n)])).fold(0.0, f64::max);
    shape_distance(motion, [from, until]) <= CLOSED * most // never of what is not finite
}

/// The times (s) of a motion before its last one, from the end, each with the time to the next one.
fn spacings(motion: &FilmedMotion<'_>) -> impl Iterator<Item = (f64, f64)> {
    motion.times().rev().zip(motion.times().rev().skip(1)).map(|(time, before)| (before, time - before))
}

/// The time between two frames at the end of a motion, s; the very last one may be nearer.
fn spacing_at_end(motion: &FilmedMotion<'_>) -> f64 {
    spacings(motion).take(3).map(|(_, spacing)| spacing).fold(0.0, f64::max)
}

/// The time (s) since which the frames of a motion show it as it is: there are enough per period of its drive (Hz), or as many as at its end.
fn densely_recorded_since(motion: &FilmedMotion<'_>, drive: Option<f64>) -> f64 {
    let enough = drive.map_or(0.0, |frequency| 1.0 / (LEAST_PER_PERIOD * frequency));
    let most = spacing_at_end(motion).max(enough) * (1.0 + SPACING_TOLERANCE);
    let dense = spacings(motion).take_while(|(_, spacing)| *spacing <= most).last();
    dense.map_or(f64::INFINITY, |(since, _)| since)
}

/// The last time (s) of a motion without a drive at which the rod had its last shape and its last velocities, and its last time: a cycle of a
/// flutter or a spin. A swing has each shape twice per cycle, with opposite velocities.
fn last_return(motion: &FilmedMotion<'_>) -> Option<[f64; 2]> {
    let (begin, end) = (motion.times().next()?, motion.times().next_back()?);
    let spacing = spacing_at_end(motion);
    let since = densely_recorded_since(motion, None).max(0.5 * (begin + end)) + spacing;
    let last_step = change_of_shape(motion, [end - spacing, end]);
    let distances = |time: f64| {
        let step = change_of_shape(motion, [time - spacing, time]);
        let change = largest(step.iter().zip(&last_step).map(|(step, last)| last - step));
        [shape_distance(motion, [time, end]), change]
    };
    let earlier = motion.times().rev().take_while(|time| *time >= since).take(MAX_ROWS_BACK);
    let earlier: Vec<(f64, [f64; 2])> = earlier.map(|time| (time, distances(time))).collect();
    let most = earlier.iter().fold([0.0, 0.0], |most, (_, distances)| [0, 1].map(|i| f64::max(most[i], distances[i])));
    // Relative to the largest one, in the shape or in the velocities.
    let apart = |distances: &[f64; 2]| f64::max(distances[0] / most[0], distances[1] / most[1]);
    let left = earlier.iter().position(|(_, distances)| apart(distances) > 0.5)?;
    let back = left + earlier[left..].iter().position(|(_, distances)| apart(distances) < CLOSED)?;
    // The closest of the rows nearby.
    let near = earlier[back..].iter().take_while(|(_, distances)| apart(distances) < CLOSED);
    near.min_by(|a, b| apart(&a.1).total_cmp(&apart(&b.1))).map(|(time, _)| [*time, end])
}

/// A speed of 1, 2 or 5 times a power of ten near `best`; 1 if that is not far from it.
fn easy_speed(best: f64) -> f64 {
    let [least, most] = REAL_TIME;
    if (least..=most).contains(&best) || !(best > 0.0 && best.is_finite()) {
        return 1.0;
    }
    let below = round_below(best);
    let distance = |speed: &f64| (speed / best).ln().abs();
    let near = [1.0, 2.0, 2.5].map(|factor| round_below(below * factor * (1.0 + 1e-9)));
    near.into_iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(1.0)
}

type Frames<'a> = &'a mut dyn Iterator<Item = Result<resvg::tiny_skia::Pixmap>>;

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]

    use super::super::frame::Frame;
    use super::super::rod_motion::{DrawnRod, RodMotion};
    use super::*;

    /// A motion of an unknown rod, with a row of positions per time.
    fn motion(times: &[f64], x: &[f64], y: &[f64]) -> RodMotion {
        let nodes = x.len() / times.len();
        let rows = x.chunks(nodes).zip(y.chunks(nodes)).zip(times);
        let frame = |((x, y), time): ((&[f64], &[f64]), &f64)| Frame {
            time: *time,
            points: x.iter().zip(y).map(|(x, y)| [*x, *y]).collect(),
            com: [0.0; 2],
            medium: None,
            loads: None,
        };
        RodMotion::whole(DrawnRod::unknown((0..nodes).collect()), rows.map(frame).collect())
    }

    #[test]
    fn a_film_that_is_stopped_leaves_the_earlier_one() {
        let folder = tempfile::tempdir().unwrap();
        let motion = motion(&[0.0, 1.0], &[0.0, 0.5, 1.0, 0.0, 0.5, 1.0], &[0.0, 0.1, 0.0, 0.0, 0.2, 0.1]);
        let motion = FilmedMotion { name: "rod", motion: &motion, cycle: None, drive: None };
        let path = folder.path().join("rod.gif");
        let settings = FilmSettings { per_second: Some(5), ..FilmSettings::default() };
        let excerpt = settings.excerpt(&path, &motion).unwrap();
        settings.write(&path, &motion, &excerpt, |_| ControlFlow::Continue(())).unwrap();
        let whole = std::fs::read(&path).unwrap();
        assert_eq!(whole.last(), Some(&b';'), "a GIF ends with its trailer");
        for stop in [0.0, 0.5] {
            let watch = |part: f64| if part >= stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
            assert_eq!(settings.write(&path, &motion, &excerpt, watch), Err(Error::Interrupted));
            assert_eq!(std::fs::read(&path).unwrap(), whole);
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_sharpness_or_a_window_that_is_no_number_is_refused() {
        let refused =
            |settings: FilmSettings| settings.check(Path::new("rod.gif"), [0.0, 1.0], None).unwrap_err().to_string();
        for sharpness in [f64::NAN, 0.0, -1.0, 1e9] {
            let said = refused(FilmSettings { sharpness, ..FilmSettings::default() });
            assert!(said.contains(&format!("found a sharpness of {sharpness}; allowed: 0.05 to 20")), "{said}");
        }
        for window in [[f64::NAN, 1.0], [0.0, f64::NAN]] {
            let said = refused(FilmSettings { window, ..FilmSettings::default() });
            assert!(said.contains("allowed: a part of the run, 0 to 1 s"), "{said}");
        }
    }

    /// A wave of this length, in a fluid of a scene, that travels by its own length in ten periods of 1 s; `rows` of them.
    fn wave(length: f64, nodes: usize, rows: usize, periods: f64) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let times: Vec<f64> = (0..rows).map(|row| periods * row as f64 / (rows - 1) as f64).collect();
        let of = |f: &dyn Fn(f64, f64) -> f64| {
            let xi = |k: usize| k as f64 / (nodes - 1) as f64;
            times.iter().flat_map(|t| (0..nodes).map(|k| length * f(xi(k), *t)).collect::<Vec<_>>()).collect()
        };
        let x = of(&|xi, t| xi - 0.1 * t);
        let y = of(&|xi, t| 0.1 * (std::f64::consts::TAU * (xi - t)).sin());
        (times, x, y)
    }

    /// An SVG film of a motion.
    fn svg(settings: &FilmSettings, motion: &FilmedMotion<'_>) -> Result<String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rod.svg");
        let excerpt = settings.excerpt(&path, motion)?;
        settings.write(&path, motion, &excerpt, |_| ControlFlow::Continue(()))?;
        Ok(std::fs::read_to_string(path).unwrap())
    }

    fn svg_of(length: f64, nodes: usize, periods: f64, cycle: Option<[f64; 2]>) -> Result<String> {
        let (times, x, y) = wave(length, nodes, 1 + (40.0 * periods) as usize, periods);
        let motion = FilmedMotion { name: "wave", motion: &motion(&times, &x, &y), cycle, drive: None };
        svg(&FilmSettings::default(), &motion)
    }

    /// The keyframes of the outline.
    fn keyframes(svg: &str) -> Vec<&str> {
        svg.split("<animate attributeName=\"d\"").nth(1).unwrap().split('"').nth(5).unwrap().split(';').collect()
    }

    #[test]
    fn a_periodic_motion_of_any_scale_is_one_cycle_whose_last_keyframe_is_its_first() {
        let mut films = Vec::new();
        for length in [1e-6, 1.0, 10.0] {
            for nodes in [3, 33, 10_000] {
                let svg = svg_of(length, nodes, 3.0, Some([2.0, 3.0])).unwrap();
                let frames = keyframes(&svg);
                assert_eq!(
                    (frames.len(), frames.first()),
                    (KEYFRAMES_OF_CYCLE as usize, frames.last()),
                    "{length} m, {nodes} nodes"
                );
                assert!(frames.iter().all(|frame| frame.matches('l').count() == frames[0].matches('l').count()));
                assert!(svg.len() < 100_000 && !svg.contains("NaN") && !svg.contains("inf"), "{} bytes", svg.len());
                films.push((nodes, frames.join(";")));
            }
        }
        // The picture does not depend on the unit of length, but for rounding to tenths of a pixel.
        let starts = |frames: &str| -> Vec<f64> {
            let starts = frames.split('M').skip(1).map(|path| path.split('l').next().unwrap().split(' '));
            starts.flatten().map(|number| number.parse().unwrap()).collect()
        };
        let same = |one: &str, other: &str| starts(one).iter().zip(starts(other)).all(|(a, b)| (a - b).abs() < 0.11);
        for (nodes, frames) in &films[3..] {
            assert!(films[..3].iter().any(|(of, other)| of == nodes && same(frames, other)), "{nodes} nodes");
        }
    }

    #[test]
    fn a_motion_without_a_drive_is_shown_from_its_last_return() {
        let svg = svg_of(1.0, 33, 3.0, None).unwrap();
        assert!(svg.contains("wave from t = 2 s to 3 s"), "{}", &svg[..600]);
        assert_eq!(keyframes(&svg).first(), keyframes(&svg).last());
    }

    #[test]
    fn a_motion_that_does_not_repeat_is_shown_as_a_whole() {
        let svg = svg_of(1.0, 33, 1.3, Some([0.2, 0.8])).unwrap();
        assert!(svg.contains("wave from t = 0 s to 1.3 s"), "{}", &svg[..600]);
        let refused = FilmSettings::default().check(Path::new("rod.svg"), [0.0, 0.0], None).unwrap_err().to_string();
        assert!(refused.contains("a film needs a run of more than one time"), "{refused}");
    }

    /// What films of a wave of this duration (s) and frequency (Hz) show, in each format.
    fn excerpts(settings: FilmSettings, periods: f64, frequency: f64, returns: bool) -> Vec<Result<FilmExcerpt>> {
        let (mut times, x, y) = wave(1.0, 3, 1 + (8.0 * periods) as usize, periods);
        times.iter_mut().for_each(|time| *time /= frequency);
        let end = times[times.len() - 1];
        let cycle = [end - if returns { 1.0 } else { 0.3 } / frequency, end];
        let motion = motion(&times, &x, &y);
        let motion = FilmedMotion { name: "wave", motion: &motion, cycle: Some(cycle), drive: Some(frequency) };
        ["rod.svg", "rod.gif", "rod.mp4"].map(|path| settings.excerpt(Path::new(path), &motion)).to_vec()
    }

    #[test]
    fn all_formats_show_the_last_cycle_of_a_motion_that_repeats_and_otherwise_as_many_periods_as_there_is_room_for() {
        for (periods, frequency, returns, part) in [
            (4.0, 1.0, true, "the last cycle, from t = 3 s to 4 s, real time"),
            (900.0, 30.0, true, "the last cycle, from t = 29.967 s to 30 s, 30 times slower"),
            (4.5, 1.0, false, "the whole run, from t = 0 s to 4.5 s, real time"),
            (20.0, 2.0, false, "the whole run, from t = 0 s to 10 s, real time"),
            (900.0, 30.0, false, "the last "),
            (900.0, 1.0, false, "the last "),
        ] {
            for shown in excerpts(FilmSettings::default(), periods, frequency, returns) {
                let shown = shown.unwrap();
                let text = shown.to_string();
                assert!(text.starts_with(part), "{text}");
                assert!(shown.pictures as f64 <= MAX_FRAMES_BY_DEFAULT && shown.window[1] == periods / frequency);
                let is_part = part == "the last ";
                assert_eq!(
                    text.ends_with("pictures: choose a part of the run with --from and --until"),
                    is_part,
                    "{text}"
                );
                let shown_periods = (shown.window[1] - shown.window[0]) * frequency;
                assert!(!is_part || (20.0..=50.0).contains(&shown_periods), "{text}");
            }
        }
    }

    #[test]
    fn a_chosen_window_with_too_many_pictures_is_refused_with_what_has_fewer() {
        let settings = FilmSettings { window: [0.0, 30.0], ..FilmSettings::default() };
        let found = excerpts(settings, 900.0, 30.0, false);
        let words = [
            "found 10801 pictures, 12 per cycle; allowed in an SVG: 301",
            "found 15000 pictures; allowed in a GIF: 3000",
        ];
        let fewer = ["", ", or give a smaller --fps or a larger --speed"];
        for ((found, words), fewer) in found.iter().zip(words).zip(fewer) {
            let said = found.as_ref().unwrap_err().to_string();
            let wanted = format!("{words}; choose a part of the run with --from and --until{fewer}");
            assert!(said.ends_with(&wanted), "{said}");
        }
        assert_eq!(found[2].as_ref().unwrap().pictures, 15000, "an MP4 may be long");
    }

    #[test]
    fn last_periods_fill_an_svg_whatever_the_rounding_of_their_times() {
        let mut settings = Vec::new();
        for duration in [20.0, 30.0, 50.0, 100.0, 1e5] {
            for frequency in [0.7, 1.1, 2.0, 2.4, 3.0, 7.3, 33.0] {
                let all = FilmSettings::default();
                let FilmedPart::LastPeriods { count, .. } = all.part(FilmFormat::Svg, duration, Some(frequency), 1e9)
                else {
                    assert!(duration * frequency <= 25.0, "{duration} s at {frequency} Hz");
                    continue;
                };
                let pictures = |span: f64| all.pictures_of(FilmFormat::Svg, span, Some(frequency));
                let window = duration - (duration - count / frequency);
                settings.push((count, pictures(count / frequency), pictures(window)));
            }
        }
        // Where the whole has hardly more than 25 periods, 24 have room.
        assert!(settings.iter().all(|found| found.0 >= 24.0 && found.1 <= 301.0 && found.2 <= 301.0), "{settings:?}");
    }

    #[test]
    fn the_last_cycle_is_that_of_the_drive_or_one_in_which_the_velocities_come_back_too() {
        let tau = std::f64::consts::TAU;
        let swing = |t: f64| (tau * t / 2.117).sin();
        let two = |t: f64| (tau * t).sin() + 0.9 * (tau * 2f64.sqrt() * t).sin();
        type Of<'a> = &'a dyn Fn(f64) -> f64;
        let [swing, two]: [Of<'_>; 2] = [&swing, &two];
        for (end, of, drive, cycle, part) in [
            (10.0, swing, None, None, Some(2.117)),
            (10.2, swing, None, None, Some(2.117)),
            (10.5, swing, None, None, Some(2.117)),
            (10.5, swing, Some(1.0 / 2.117), None, None),
            (10.5, swing, Some(1.0 / 2.117), Some([10.5 - 2.117, 10.5]), Some(2.117)),
            (10.0, two, Some(2f64.sqrt()), None, None),
            (11.7, two, Some(2f64.sqrt()), None, None),
        ] {
            let times: Vec<f64> = (0..=2000).map(|n| end * f64::from(n) / 2000.0).collect();
            let x = [0.0, 0.5, 1.0].repeat(times.len());
            let y: Vec<f64> = times.iter().flat_map(|t| [0.0, 0.1, 0.3].map(|part| part * of(*t))).collect();
            let motion = FilmedMotion { name: "rod", motion: &motion(&times, &x, &y), cycle, drive };
            for path in ["rod.svg", "rod.gif"] {
                let shown = FilmSettings::default().excerpt(Path::new(path), &motion).unwrap();
                let case = format!("{end} s, {drive:?}, {path}: {shown}");
                assert_eq!(shown.part == FilmedPart::Cycle, part.is_some(), "{case}");
                let span = shown.window[1] - shown.window[0];
                assert!((span - part.unwrap_or(end)).abs() < 0.02, "{case}");
            }
        }
    }

    #[test]
    fn a_cycle_is_shown_only_where_its_frames_are_dense() {
        // A slow motion and a fast one, of which only the last 5 s are recorded densely.
        let early = (0..950).map(|n| 0.1 * f64::from(n)).filter(|time| *time < 95.0);
        let times: Vec<f64> = early.chain((0..=2400).map(|n| 95.0 + 5.0 * f64::from(n) / 2400.0)).collect();
        let tau = std::f64::consts::TAU;
        let of = |t: f64| (0.1 * tau * t).sin() + 0.1 * (10.0 * tau * t).sin();
        let x = [0.0, 0.5, 1.0].repeat(times.len());
        let y: Vec<f64> = times.iter().flat_map(|t| [0.0, 0.1, 0.3].map(|part| part * of(*t))).collect();
        let motion = motion(&times, &x, &y);
        for (cycle, drive) in [(Some([90.0, 100.0]), Some(10.0)), (None, None), (Some([90.0, 100.0]), None)] {
            let motion = FilmedMotion { name: "rod", motion: &motion, cycle, drive };
            for path in ["rod.gif", "rod.mp4"] {
                let shown = FilmSettings::default().excerpt(Path::new(path), &motion).unwrap();
                assert!(shown.part != FilmedPart::Cycle, "{drive:?}, {path}: {shown}");
                assert!(shown.pictures <= 600 && (drive.is_none() || shown.window[0] >= 95.0), "{path}: {shown}");
            }
        }
    }

    #[test]
    fn a_slow_film_shows_the_last_period_where_that_has_room_and_is_otherwise_refused_before_the_run() {
        for (speed, count) in [(0.02, Some(1.0)), (0.05, Some(1.0)), (0.1, Some(2.0)), (1e-3, None)] {
            let settings = FilmSettings { speed: Some(speed), ..FilmSettings::default() };
            let checked = settings.check(Path::new("rod.gif"), [0.0, 8.0], Some(1.0));
            let shown = excerpts(settings, 8.0, 1.0, false).remove(1);
            assert_eq!(checked.is_ok(), shown.is_ok(), "{speed}: {checked:?}, {shown:?}");
            let found = shown.ok().map(|shown| (shown.part, shown.window));
            let window = count.map(|count| [8.0 - count, 8.0]);
            assert_eq!(found.map(|(_, window)| window), window, "{speed}");
            assert!(found.is_none_or(|(part, _)| matches!(part, FilmedPart::LastPeriods { .. })), "{speed}");
        }
    }

    #[test]
    fn a_film_of_any_part_of_a_motion_lasts_as_long_as_one_can_see_it() {
        for (span, frequency) in [(1e-4, Some(2.0)), (1e-4, None), (0.02, Some(0.1)), (3.0, Some(100.0)), (1e4, None)] {
            let speed = FilmSettings::default().speed_of(span, frequency);
            assert!((1.0..1000.0).contains(&(span / speed)), "{span} s at {frequency:?} Hz: {} s", span / speed);
        }
    }

    #[test]
    fn a_film_replaces_an_earlier_film_and_another_file_only_by_force() {
        let folder = tempfile::tempdir().unwrap();
        let motion = motion(&[0.0, 1.0], &[0.0, 0.5, 1.0, 0.0, 0.5, 1.0], &[0.0, 0.1, 0.0, 0.0, 0.2, 0.1]);
        let motion = FilmedMotion { name: "rod", motion: &motion, cycle: None, drive: None };
        for name in ["rod.svg", "rod.gif"] {
            let path = folder.path().join(name);
            let write = |claim: Claim| {
                let settings = FilmSettings { claim, speed: Some(10.0), ..FilmSettings::default() };
                let excerpt = settings.excerpt(&path, &motion)?;
                settings.write(&path, &motion, &excerpt, |_| ControlFlow::Continue(()))
            };
            for (there, own) in [("", true), ("<svg>mine</svg>", false)] {
                std::fs::write(&path, there).unwrap();
                let found = write(Claim::Own);
                assert_eq!(found.is_ok(), own, "{name}");
                if let Err(refused) = found {
                    let said = refused.to_string();
                    assert!(
                        said.contains("there is a file that caudal did not write; choose another name")
                            && said.ends_with("replace it with --force")
                    );
                    assert_eq!(std::fs::read_to_string(&path).unwrap(), there);
                    write(Claim::Force).unwrap();
                }
                write(Claim::Own).unwrap();
            }
        }
    }

    #[test]
    fn a_rod_at_rest_and_one_in_a_single_place_have_a_picture() {
        for x in [[0.0, 0.5, 1.0, 0.0, 0.5, 1.0], [0.0; 6]] {
            let motion =
                FilmedMotion { name: "<&>", motion: &motion(&[0.0, 1.0], &x, &[0.0; 6]), cycle: None, drive: None };
            let svg = svg(&FilmSettings::default(), &motion).unwrap();
            assert!(!svg.contains("NaN") && !svg.contains("inf") && svg.contains("&lt;&amp;&gt;"), "{svg}");
            assert!(SvgRenderer::new().pixels(&svg, 1.0).is_ok());
        }
    }

    #[test]
    fn of_two_films_that_of_the_faster_beat_never_looks_slower() {
        let frequencies = [0.01, 0.1, 0.25, 0.5, 0.9, 1.0, 1.1, 2.0, 2.4, 2.6, 3.0, 7.0, 30.0, 250.0];
        let shown = frequencies.map(|frequency| {
            let speed = usual_speed(f64::recip(frequency), Some(f64::recip(frequency)));
            assert!((frequency < 0.25) == (speed > 1.0), "{frequency} Hz at {speed}");
            speed * frequency
        });
        assert!(
            shown.windows(2).all(|pair| pair[0] <= pair[1] * (1.0 + 1e-12)),
            "beats per second of films: {shown:?}"
        );
    }

    #[test]
    fn a_film_of_pictures_has_twelve_per_beat_unless_it_is_asked_for_another_speed_and_then_it_says_so() {
        let path = Path::new("rod.gif");
        for span in [0.01, 0.5, 8.0, 1000.0] {
            for frequency in [0.5, 3.0, 30.0, 240.0] {
                for per_second in [10, 25, 50] {
                    let settings = FilmSettings { per_second: Some(per_second), ..FilmSettings::default() };
                    let rate = f64::from(per_second) / (settings.speed_of(span, Some(frequency)) * frequency);
                    assert!(
                        rate >= LEAST_PER_PERIOD * (1.0 - 1e-9),
                        "{span} s, {frequency} Hz, {per_second}/s: {rate}"
                    );
                    assert_eq!(settings.warning(path, Some(frequency)), None);
                }
            }
        }
        let fast = FilmSettings { speed: Some(1.0), ..FilmSettings::default() };
        let said = fast.warning(path, Some(30.0)).unwrap();
        assert!(
            said.contains("rod.gif has 0.83 pictures per period of the fastest drive") && said.contains("--speed 0.05"),
            "{said}"
        );
        assert_eq!(fast.warning(path, Some(2.0)), None);
    }

    #[test]
    fn a_film_of_whole_periods_loops_without_a_jump() {
        let (times, x, y) = wave(1.0, 33, 200, 5.0);
        let mut motion = motion(&times, &x, &y);
        let fluid = crate::fluid::Fluid { density: 1000.0, ..crate::fluid::Fluid::NONE };
        for frame in &mut motion.frames {
            frame.medium = Some(super::super::frame::Medium { fluid, layers: None });
        }
        let motion = FilmedMotion { name: "wave", motion: &motion, cycle: None, drive: Some(1.0) };
        for window in [[3.0, 4.0], [1.0, 4.0], [2.0, 3.001]] {
            assert!(closes(&motion, window), "{window:?}");
            let scene = FilmScene::of(motion, window, LOOKS, true).looping();
            let [first, last] = window.map(|time| scene.picture(time, ""));
            // A shift by a whole cell is none.
            let shift =
                |picture: &str| picture.split("translate(").nth(2).unwrap().split(' ').next().unwrap().to_string();
            let [from, to]: [f64; 2] = [&first, &last].map(|picture| shift(picture).parse().unwrap());
            assert!(from == 0.0 && (to < 0.2 || (to - scene.cell()).abs() < 0.2), "{window:?}: {from} {to}");
            assert_eq!(
                first,
                last.replacen(&format!("translate({} 0)", shift(&last)), "translate(0 0)", 1),
                "{window:?}"
            );
        }
        assert!(!closes(&motion, [3.0, 4.3]));
    }

    #[test]
    fn a_film_is_slowed_down_or_sped_up_by_round_factors() {
        for (best, speed) in
            [(0.02, 0.02), (0.021, 0.02), (0.034, 0.05), (0.08, 0.1), (0.3, 1.0), (2.0, 1.0), (4.2, 5.0), (1e4, 1e4)]
        {
            assert!((easy_speed(best) / speed - 1.0).abs() < 1e-6, "{best}: {}", easy_speed(best));
        }
    }
}
