//! Progress of a long command on a terminal: the amount done, the rate, and the time left.
//!
//! Work stores its position in an atomic number; a thread draws it ten times a second, without escape codes.

use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use caudal::number_format::in_sentence;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle, TermLike};

use super::is_quiet;

/// Time between two updates.
const INTERVAL: Duration = Duration::from_millis(100);

/// A command that finishes within this time shows no progress.
const SHORT: Duration = Duration::from_millis(500);

/// Maximum and minimum number of cells of a bar.
const CELLS: usize = 24;
const MIN_CELLS: usize = 4;

/// Width of a terminal of unknown width.
const DEFAULT_WIDTH: u16 = 80;

/// What is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Simulated time, s.
    SimulatedSeconds,
    /// Things of this name in the plural, of which there are so many.
    Exactly(&'static str),
    /// The same, of which there are no more than so many.
    #[cfg_attr(not(feature = "design"), allow(dead_code, reason = "only designs end early"))]
    AtMost(&'static str),
    /// Parts whose durations tell nothing of each other's: no rate, and no time left.
    Parts,
}

/// Progress that is shown on a terminal until it is dropped; nothing is shown if there is no terminal, with `--quiet`, or for short work.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
    counter: Arc<Counter>,
}

/// The progress that is shown now.
static SHOWN: Mutex<Option<ProgressBar>> = Mutex::new(None);

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Progress {
    /// Shows progress towards `total` in this unit, starting at zero.
    pub fn of(unit: Unit, total: f64) -> Self {
        let session = Session { first: 0.0, total, begun: Instant::now() };
        let counter = Arc::new(Counter {
            unit,
            begun: Instant::now(),
            done: AtomicU64::new(0),
            session: Mutex::new(session),
            note: Mutex::default(),
        });
        let bar = if is_quiet() || !is_attended() {
            ProgressBar::hidden()
        } else {
            let bar = ProgressBar::with_draw_target(
                None,
                ProgressDrawTarget::term_like_with_hz(Box::new(Terminal::default()), 10),
            );
            let shown = Arc::clone(&counter);
            let line = move |_: &ProgressState, out: &mut dyn std::fmt::Write| {
                let _ = out.write_str(&shown.line(Instant::now(), usize::from(columns())));
            };
            if let Ok(style) = ProgressStyle::with_template("{line}") {
                bar.set_style(style.with_key("line", line));
            }
            bar.enable_steady_tick(INTERVAL);
            *locked(&SHOWN) = Some(bar.clone());
            bar
        };
        Self { bar, counter }
    }

    /// Sets the amount done so far.
    pub fn set(&self, done: f64) {
        self.counter.done.store(done.to_bits(), Ordering::Relaxed);
    }

    /// Sets the amount done of a list of `total`. A new list, and the amount of it done before, do not count for the rate.
    pub fn set_of(&self, done: f64, total: f64) {
        let mut session = locked(&self.counter.session);
        if session.total != total || done < self.counter.done() {
            *session = Session { first: done, total, begun: Instant::now() };
        }
        self.set(done);
    }

    /// A note after the numbers.
    pub fn note(&self, note: impl Into<String>) {
        *locked(&self.counter.note) = note.into();
    }

    /// Time since the start.
    pub fn elapsed(&self) -> Duration {
        self.counter.begun.elapsed()
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        locked(&SHOWN).take();
    }
}

/// Removes the progress from the terminal for good, before another thread ends the program.
pub fn clear() {
    if let Some(bar) = locked(&SHOWN).take() {
        bar.finish_and_clear();
    }
}

/// Calls `print` while the progress is hidden.
pub fn suspended<T>(print: impl FnOnce() -> T) -> T {
    let bar = locked(&SHOWN).clone();
    match bar {
        Some(bar) => bar.suspend(print),
        None => print(),
    }
}

/// True if standard error is a terminal that can return to the start of a line.
fn is_attended() -> bool {
    let name = std::env::var_os("TERM");
    std::io::stderr().is_terminal() && name.map_or(cfg!(windows), |name| name != "dumb")
}

/// The counted unit, and the current amount.
#[derive(Debug)]
struct Counter {
    unit: Unit,
    begun: Instant,
    /// Bits of a floating-point number.
    done: AtomicU64,
    session: Mutex<Session>,
    note: Mutex<String>,
}

/// Work that is done without interruption.
#[derive(Debug, Clone, Copy)]
struct Session {
    /// The amount done before.
    first: f64,
    total: f64,
    begun: Instant,
}

impl Counter {
    fn done(&self) -> f64 {
        f64::from_bits(self.done.load(Ordering::Relaxed))
    }

    /// The line for a terminal with this number of columns.
    fn line(&self, now: Instant, columns: usize) -> String {
        let so_far = now.duration_since(self.begun);
        if so_far < SHORT {
            return String::new();
        }
        let (Session { first, total, begun }, done) = (*locked(&self.session), self.done());
        let note = locked(&self.note).clone();
        let cut = |line: String| line.chars().take(columns).collect::<String>();
        let so_far = format!("{} so far", HumanDuration(so_far));
        if self.unit == Unit::Parts || total <= 0.0 {
            return cut(if note.is_empty() { so_far } else { format!("{note}, {so_far}") });
        }
        let fraction = (done / total).clamp(0.0, 1.0);
        let mut line = format!("{:>3.0} %  ", (100.0 * fraction).floor());
        line += &match self.unit {
            Unit::SimulatedSeconds => format!("t = {} of {} s", in_sentence(done, 3), in_sentence(total, 4)),
            Unit::AtMost(name) => format!("{done} of at most {total} {name}"),
            Unit::Exactly(name) => format!("{done} of {total} {name}"),
            Unit::Parts => String::new(),
        };
        let rate = (done - first) / now.duration_since(begun).as_secs_f64();
        line += &if rate > 0.0 && rate.is_finite() {
            let most = if matches!(self.unit, Unit::AtMost(_)) { "at most " } else { "" };
            // No time left is shown if it is too long for a clock.
            let left = Duration::try_from_secs_f64(((total - done) / rate).max(0.0));
            let left =
                left.map_or_else(|_| "endless".to_string(), |left| format!("{most}{} left", HumanDuration(left)));
            format!("  {}  {left}", self.unit.rate(rate))
        } else {
            format!("  {so_far}")
        };
        if !note.is_empty() {
            line = format!("{line}  {note}");
        }
        // The bar fills the columns that the numbers leave.
        let cells = columns.saturating_sub(line.chars().count() + 1).min(CELLS);
        if cells >= MIN_CELLS {
            let full = (fraction * cells as f64) as usize;
            line = format!("{}{} {line}", "█".repeat(full), "░".repeat(cells - full));
        }
        cut(line)
    }
}

impl Unit {
    /// A rate per second, in a unit of time in which it is one or more.
    fn rate(self, per_second: f64) -> String {
        match self {
            Self::SimulatedSeconds | Self::Parts => format!("{} s/s", in_sentence(per_second, 3)),
            Self::Exactly(name) | Self::AtMost(name) => {
                let units = [(1.0, "s"), (60.0, "min"), (3600.0, "h")];
                let found = units.iter().find(|(seconds, _)| per_second * seconds >= 1.0);
                let (seconds, unit) = found.unwrap_or(&units[2]);
                format!("{} {name}/{unit}", in_sentence(per_second * seconds, 3))
            }
        }
    }
}

/// Standard error as a terminal on which one line is overwritten repeatedly, without escape codes.
#[derive(Debug, Default)]
struct Terminal {
    /// Text to be written at once.
    pending: Mutex<String>,
}

/// Columns of the terminal that a line may fill: the last one would begin a new line.
fn columns() -> u16 {
    #[cfg(unix)]
    let columns = rustix::termios::tcgetwinsize(std::io::stderr()).map_or(0, |size| size.ws_col);
    #[cfg(not(unix))]
    let columns = 0;
    let columns = if columns == 0 { DEFAULT_WIDTH } else { columns };
    columns.saturating_sub(1).max(1)
}

impl TermLike for Terminal {
    fn width(&self) -> u16 {
        columns()
    }

    fn move_cursor_up(&self, _: usize) -> std::io::Result<()> {
        Ok(())
    }

    fn move_cursor_down(&self, _: usize) -> std::io::Result<()> {
        Ok(())
    }

    fn move_cursor_right(&self, _: usize) -> std::io::Result<()> {
        Ok(())
    }

    fn move_cursor_left(&self, _: usize) -> std::io::Result<()> {
        Ok(())
    }

    fn write_line(&self, line: &str) -> std::io::Result<()> {
        self.write_str(line)
    }

    fn write_str(&self, text: &str) -> std::io::Result<()> {
        locked(&self.pending).push_str(text);
        Ok(())
    }

    fn clear_line(&self) -> std::io::Result<()> {
        let blank = " ".repeat(usize::from(self.width()));
        locked(&self.pending).push_str(&format!("\r{blank}\r"));
        Ok(())
    }

    fn flush(&self) -> std::io::Result<()> {
        // Return to the start, so that an echoed ^C is overwritten.
        let text = std::mem::take(&mut *locked(&self.pending)) + "\r";
        let mut out = std::io::stderr().lock();
        out.write_all(text.as_bytes())?;
        out.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counter(unit: Unit, first: f64, total: f64, done: f64, seconds: f64) -> (Counter, Instant) {
        let now = Instant::now() + Duration::from_secs(7200);
        let begun = now - Duration::from_secs_f64(seconds);
        let session = Mutex::new(Session { first, total, begun });
        (Counter { unit, begun, done: AtomicU64::new(done.to_bits()), session, note: Mutex::default() }, now)
    }

    #[test]
    fn a_resumed_sweep_foretells_by_the_rate_of_this_session() {
        let (counter, now) = counter(Unit::Exactly("cases"), 900.0, 1000.0, 910.0, 20.0);
        let line = counter.line(now, 120);
        assert!(line.ends_with(" 91 %  910 of 1000 cases  30 cases/min  3 minutes left"), "{line}");
    }

    #[test]
    fn a_run_says_its_time_its_rate_and_the_time_left() {
        let (counter, now) = counter(Unit::SimulatedSeconds, 0.0, 20.0, 5.0, 10.0);
        let line = counter.line(now, 120);
        assert_eq!(line, format!("{}{}  25 %  t = 5 of 20 s  0.5 s/s  30 seconds left", "█".repeat(6), "░".repeat(18)));
    }

    #[test]
    fn before_anything_is_done_only_the_time_so_far_is_said() {
        let (unknown, now) = counter(Unit::Exactly("simulations"), 3.0, 12.0, 3.0, 65.0);
        assert!(
            unknown.line(now, 120).ends_with("3 of 12 simulations  65 seconds so far"),
            "{}",
            unknown.line(now, 120)
        );
        let (short, now) = counter(Unit::SimulatedSeconds, 0.0, 20.0, 5.0, 0.4);
        assert_eq!(short.line(now, 120), "");
        let (never, now) = counter(Unit::SimulatedSeconds, 0.0, 1e300, 1e-300, 10.0);
        assert!(never.line(now, 120).ends_with("endless"), "{}", never.line(now, 120));
    }

    #[test]
    fn a_line_is_never_wider_than_the_terminal() {
        let (counter, now) = counter(Unit::AtMost("iterations"), 0.0, 603.0, 32.0, 5.5);
        *locked(&counter.note) = "of the front".to_string();
        for columns in 1..140 {
            let line = counter.line(now, columns);
            assert!(line.chars().count() <= columns, "{columns}: {line}");
        }
        let wide = "  5 %  32 of at most 603 iterations  5.82 iterations/s  at most 2 minutes left  of the front";
        assert_eq!(counter.line(now, 100), format!("{} {wide}", "░".repeat(7)), "a bar has what is left");
        assert_eq!(counter.line(now, 95), wide);
    }
}
