//! Work on many items at once, whose results are taken in order.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What the tasks share.
struct State<T, E, F> {
    /// Items begun, and results taken.
    begun: usize,
    taken: usize,
    /// Results that wait for their turn.
    ready: BTreeMap<usize, Result<T, E>>,
    /// Who takes them; nobody while a task does.
    take: Option<F>,
    error: Option<E>,
}

/// Makes items `0..count` on all threads of the pool and gives them to `take` one at a time, in
/// order. At most `ahead` are being made or wait to be taken: that bounds the memory. Nobody ever
/// waits for another: the task that finishes an item takes all that are ready, unless one is at it
/// already.
///
/// # Errors
/// That of the lowest item that fails, or of `take`; items after it may or may not be made.
pub(crate) fn in_order<T: Send, E: Send>(
    count: usize,
    ahead: usize,
    make: impl Fn(usize) -> Result<T, E> + Sync,
    take: impl FnMut(T) -> Result<(), E> + Send,
) -> Result<(), E> {
    let state = Mutex::new(State {
        begun: 0,
        taken: 0,
        ready: BTreeMap::new(),
        take: Some(take),
        error: None,
    });
    let tasks = Tasks { count, state: &state, make: &make };
    rayon::scope(|scope| {
        for _ in 0..ahead.clamp(1, count.max(1)) {
            let tasks = &tasks;
            scope.spawn(move |scope| tasks.one(scope));
        }
    });
    match state.into_inner().unwrap_or_else(PoisonError::into_inner).error {
        Some(error) => Err(error),
        None => Ok(()),
    }
}

struct Tasks<'a, T, E, F, M> {
    count: usize,
    state: &'a Mutex<State<T, E, F>>,
    make: &'a M,
}

impl<T, E, F, M> Tasks<'_, T, E, F, M>
where
    T: Send,
    E: Send,
    F: FnMut(T) -> Result<(), E> + Send,
    M: Fn(usize) -> Result<T, E> + Sync,
{
    fn lock(&self) -> MutexGuard<'_, State<T, E, F>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes the next item, and takes what is ready.
    fn one<'s>(&'s self, scope: &rayon::Scope<'s>) {
        let item = {
            let mut state = self.lock();
            if state.begun == self.count || state.error.is_some() {
                return;
            }
            state.begun += 1;
            state.begun - 1
        };
        let made = (self.make)(item);
        let mut state = self.lock();
        state.ready.insert(item, made);
        let Some(mut take) = state.take.take() else { return };
        while state.error.is_none() {
            let next = state.taken;
            let Some(made) = state.ready.remove(&next) else { break };
            drop(state);
            let outcome = made.and_then(&mut take);
            state = self.lock();
            state.taken += 1;
            state.error = outcome.err();
            if state.begun < self.count && state.error.is_none() {
                scope.spawn(|scope| self.one(scope));
            }
        }
        state.take = Some(take);
    }
}

/// Runs `work` on every item on all threads, the longest first, so that no core waits for one that
/// was begun last; results in the order of the items.
pub(crate) fn longest_first<I: Send, L: Ord, T: Send>(
    items: Vec<I>,
    length: impl Fn(&I) -> L,
    work: impl Fn(I) -> T + Sync,
) -> Vec<T> {
    in_turn(items, |item| std::cmp::Reverse(length(item)), work)
}

/// The same, the least `turn` first.
pub(crate) fn in_turn<I: Send, L: Ord, T: Send>(
    items: Vec<I>,
    turn: impl Fn(&I) -> L,
    work: impl Fn(I) -> T + Sync,
) -> Vec<T> {
    let mut slots: Vec<Option<T>> = items.iter().map(|_| None).collect();
    let mut jobs: Vec<(I, &mut Option<T>)> = items.into_iter().zip(&mut slots).collect();
    jobs.sort_by_key(|(item, _)| turn(item));
    rayon::scope_fifo(|scope| {
        for (item, slot) in jobs {
            let work = &work;
            scope.spawn_fifo(move |_| *slot = Some(work(item)));
        }
    });
    slots.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn results_come_in_order_and_few_are_ahead() {
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let made = AtomicUsize::new(0);
            let mut taken = Vec::new();
            let make = |i: usize| {
                made.fetch_add(1, Ordering::SeqCst);
                std::thread::sleep(std::time::Duration::from_micros((i as u64 * 37) % 5 * 100));
                Ok::<_, ()>(i)
            };
            let take = |i| {
                assert!(made.load(Ordering::SeqCst) <= taken.len() + 4);
                taken.push(i);
                Ok(())
            };
            pool.install(|| in_order(100, 4, make, take)).unwrap();
            assert_eq!(taken, (0..100).collect::<Vec<_>>());
        }
    }

    #[test]
    fn the_lowest_error_counts() {
        let mut taken = 0;
        let make = |i| if i >= 7 { Err(i) } else { Ok(i) };
        let take = |_| {
            taken += 1;
            Ok(())
        };
        assert_eq!(in_order(20, 5, make, take), Err(7));
        assert_eq!(taken, 7);
        assert_eq!(in_order(9, 3, Ok, |i| if i == 3 { Err(i) } else { Ok(()) }), Err(3));
        assert_eq!(in_order(0, 3, Ok::<usize, usize>, |_| Ok(())), Ok(()));
    }

    #[test]
    fn results_of_the_longest_first_are_in_the_order_of_the_items() {
        for n in [0, 1, 40] {
            let items: Vec<usize> = (0..n).map(|i| i * 17 % 41).collect();
            assert_eq!(longest_first(items.clone(), |&i| i, |i| i), items);
        }
    }
}
