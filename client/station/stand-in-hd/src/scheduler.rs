//! The thread that calls the tasks.

use std::thread;
use std::time::{Duration, Instant};

use crate::CONTROL;

pub(crate) fn start() {
    let mut world = CONTROL.world();
    if !world.is_running {
        world.is_running = true;
        world.thread = Some(thread::spawn(run));
    }
}

/// When this returns no task is called any more.
pub(crate) fn stop() {
    let thread = {
        let mut world = CONTROL.world();
        world.is_running = false;
        world.thread.take()
    };
    if let Some(thread) = thread {
        thread.join().expect("tasks do not unwind");
    }
    CONTROL.world().go_slack();
}

fn run() {
    let mut deadline = Instant::now();
    loop {
        let (mut tasks, period) = {
            let world = CONTROL.world();
            if !world.is_running {
                return;
            }
            (world.tasks.clone(), Duration::from_secs_f64(1.0 / world.rate_hz))
        };
        tasks.sort_by_key(|task| std::cmp::Reverse(task.priority));
        for task in tasks {
            // The world is not held: a task calls the library.
            if (task.callback)(task.data as *mut _) == 0 {
                CONTROL.world().tasks.retain(|other| other.id != task.id);
            }
        }
        deadline = (deadline + period).max(Instant::now());
        thread::sleep(deadline - Instant::now().min(deadline));
    }
}
