//! A value on a thread of its own, which Python's threads ask in turn: for what holds a link to a microcontroller, which need not
//! be able to change threads.
//! Limits: a process that was forked has the value but not its thread, and is refused.

use std::sync::mpsc::{Sender, channel};
use std::thread;

use pyo3::prelude::*;

use crate::error::failed;

type Job<T> = Box<dyn FnOnce(&mut T) + Send>;

/// The value's thread ends with this.
pub(crate) struct Worker<T> {
    jobs: Sender<Job<T>>,
    process: u32,
}

impl<T: 'static> Worker<T> {
    /// Makes the value on its thread and waits for that.
    ///
    /// # Errors
    /// Those of `make`.
    pub(crate) fn start(make: impl FnOnce() -> PyResult<T> + Send + 'static) -> PyResult<Self> {
        let (jobs, todo) = channel::<Job<T>>();
        let (reply, answer) = channel();
        let serve = move || match make() {
            Ok(mut value) => {
                // Who started this may be gone: then there are no jobs either.
                let _ = reply.send(Ok(()));
                for job in todo {
                    job(&mut value);
                }
            }
            Err(error) => {
                let _ = reply.send(Err(error));
            }
        };
        thread::Builder::new()
            .name("gripline".to_owned())
            .spawn(serve)
            .map_err(|error| failed(format!("no thread can be started: {error}, expected one")))?;
        answer.recv().map_err(|_| defect())??;
        Ok(Self {
            jobs,
            process: std::process::id(),
        })
    }

    /// Has the value do something and waits for it. Call this detached from Python.
    ///
    /// # Errors
    /// Python's `GriplineError` when this process was forked since, or the value's thread has ended.
    pub(crate) fn call<R: Send + 'static>(
        &self,
        job: impl FnOnce(&mut T) -> R + Send + 'static,
    ) -> PyResult<R> {
        if std::process::id() != self.process {
            return Err(failed(
                "found a process that was forked after this object was made, expected the one that made it: make it in \
                 the new process",
            ));
        }
        let (reply, answer) = channel();
        let job: Job<T> = Box::new(move |value| {
            // Nobody waits any more when the process is ending.
            let _ = reply.send(job(value));
        });
        self.jobs.send(job).map_err(|_| defect())?;
        answer.recv().map_err(|_| defect())
    }
}

fn defect() -> PyErr {
    failed("the thread behind this object has ended, expected an answer: report this defect")
}
