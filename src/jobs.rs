//! Resumable jobs: many independent runs on all cores, with each result on disk as soon as it is finished. A job resumes after any
//! end, including `kill -9` and power cuts.
//!
//! A [`Journal`] is one file of lines `checksum json`: first the identity of the job, then one line per result in the order in
//! which they finished. [`run`] works through indices on several threads; a [`Shard`] is a part of a job for one of several
//! programs.

mod journal;

use std::ops::ControlFlow;
use std::str::FromStr;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::sync_channel;
use std::thread::Scope;

use twox_hash::XxHash3_64;

#[cfg(unix)]
pub use journal::held_descriptors;
#[cfg(feature = "report")]
pub(crate) use journal::of_another_job;
pub use journal::{BUILD, Job, Journal, hash, line, read_line};

use crate::error::{Error, Result};

/// A fixed pseudo-random permutation of the numbers below `size`, so that any part of it is a representative sample.
pub fn shuffled(size: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..size).collect();
    order.sort_by_cached_key(|index| XxHash3_64::oneshot(&(*index as u64).to_le_bytes()));
    order
}

/// One of several equal parts of a job, each run by a separate program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// Number of the shard, from 1.
    pub number: usize,
    /// The number of shards.
    pub of: usize,
}

impl Shard {
    /// The shard's indices in a job of `size`, in increasing order. Shards are disjoint and cover the job, their sizes differ by at
    /// most one, and cheap and expensive indices are spread at random.
    pub fn indices(self, size: usize) -> Vec<usize> {
        let mut own: Vec<usize> = shuffled(size).into_iter().skip(self.number - 1).step_by(self.of).collect();
        own.sort_unstable();
        own
    }
}

impl FromStr for Shard {
    type Err = String;

    /// Parses `2/8`.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let parts = text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
        match parts {
            Some((number, of)) if 1 <= number && number <= of => Ok(Self { number, of }),
            _ => Err("allowed: i/n with i from 1 to n, such as 1/8".to_string()),
        }
    }
}

/// Stack size of a thread, B, and the free memory that is required before it is started: the stack, and what the runtime allocates.
const STACK: usize = 2 << 20;
const MIN_FREE_MEMORY: usize = STACK + (4 << 20);

/// Number of cores of this machine.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Runs `work` for each index of `todo`, see [`run_chunks`].
///
/// # Errors
/// Errors of [`run_chunks`].
pub fn run<T: Send>(
    todo: &[usize],
    threads: usize,
    work: impl Fn(usize) -> T + Sync,
    done: impl FnMut(usize, T) -> Result<ControlFlow<()>>,
) -> Result<()> {
    run_chunks(todo, threads, 1, |indices| indices.iter().map(|index| work(*index)).collect(), done)
}

/// Starts `work` on a thread; `Err` has the reason if the system refuses.
pub(crate) fn spawn<'scope>(
    scope: &'scope Scope<'scope, '_>,
    work: impl FnOnce() + Send + 'scope,
) -> std::result::Result<(), String> {
    // A thread that gets its stack but too little memory for the runtime's own data would abort the program.
    Vec::<u8>::new().try_reserve_exact(MIN_FREE_MEMORY).map_err(|error| error.to_string())?;
    let builder = std::thread::Builder::new().stack_size(STACK);
    builder.spawn_scoped(scope, work).map(drop).map_err(|error| error.to_string())
}

/// Runs `work` on chunks of at most `together` indices of `todo`, in this order, on `threads` threads; it returns one result per
/// index. `done` receives each result on the calling thread, in order of completion. After it breaks or fails, no further work
/// starts, and results of running work are dropped: `work` should check the same flag as `done`.
///
/// # Errors
/// Errors of `done`; [`Error::Threads`] if the system does not provide that many threads, before any work starts.
pub fn run_chunks<T: Send>(
    todo: &[usize],
    threads: usize,
    together: usize,
    work: impl Fn(&[usize]) -> Vec<T> + Sync,
    mut done: impl FnMut(usize, T) -> Result<ControlFlow<()>>,
) -> Result<()> {
    let (next, ended) = (AtomicUsize::new(0), AtomicBool::new(false));
    let threads = threads.clamp(1, todo.len().max(1));
    let (sender, results) = sync_channel(2 * threads);
    let gate = Mutex::new(());
    std::thread::scope(|scope| {
        let closed = gate.lock();
        for started in 0..threads {
            let sender = sender.clone();
            let worker = || {
                let sender = sender;
                drop(gate.lock()); // until all threads have started
                // Chunks are sized so that every thread gets a share of what is left.
                let some = |first: usize| first + (todo.len() - first).div_ceil(threads).clamp(1, together);
                let take = |first: usize| (first < todo.len()).then(|| some(first));
                while !ended.load(Ordering::Relaxed)
                    && let Ok(first) = next.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take)
                {
                    let indices = &todo[first..some(first)];
                    for (index, result) in indices.iter().zip(work(indices)) {
                        if sender.send((*index, result)).is_err() {
                            return;
                        }
                    }
                }
            };
            if let Err(reason) = spawn(scope, worker) {
                ended.store(true, Ordering::Relaxed);
                return Err(Error::Threads { wanted: threads, started, reason });
            }
        }
        drop((closed, sender));
        // Dropping the receiver ends threads that wait to hand over their result.
        for (index, result) in results {
            match done(index, result) {
                Ok(ControlFlow::Continue(())) => {}
                outcome => {
                    ended.store(true, Ordering::Relaxed);
                    return outcome.map(|_| ());
                }
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use super::*;

    #[test]
    fn shards_are_disjoint_whole_and_of_like_size() {
        for (size, of) in [(192, 5), (7, 7), (3, 8), (1000, 1)] {
            let shards: Vec<_> = (1..=of).map(|number| Shard { number, of }.indices(size)).collect();
            assert!(shards.iter().all(|shard| (size / of..=size.div_ceil(of)).contains(&shard.len())));
            let mut all = shards.concat();
            all.sort_unstable();
            assert_eq!(all, (0..size).collect::<Vec<_>>());
        }
        // Journals of shards rely on this order: it must not change.
        assert_eq!(Shard { number: 1, of: 4 }.indices(12), [3, 8, 9]);
        assert_eq!("2/8".parse(), Ok(Shard { number: 2, of: 8 }));
        assert!(["0/2", "3/2", "2", "a/b", "-1/2"].iter().all(|text| text.parse::<Shard>().is_err()));
    }

    #[test]
    fn every_index_is_worked_on_once_whatever_the_number_of_threads_and_a_break_ends_it() {
        let todo: Vec<usize> = (0..1000).rev().collect();
        for threads in [1, 2, 7] {
            let mut seen = Vec::new();
            run_chunks(
                &todo,
                threads,
                3,
                |indices| indices.iter().map(|index| 2 * index).collect(),
                |index, result| {
                    assert_eq!(result, 2 * index);
                    seen.push(index);
                    Ok(ControlFlow::Continue(()))
                },
            )
            .unwrap();
            seen.sort_unstable();
            assert_eq!(seen, (0..1000).collect::<Vec<_>>());
            let mut count = 0;
            run(
                &todo,
                threads,
                |index| index,
                |_, _| {
                    count += 1;
                    Ok(if count == 10 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
                },
            )
            .unwrap();
            assert_eq!(count, 10);
        }
    }
}
