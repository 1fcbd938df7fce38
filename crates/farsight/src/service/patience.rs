//! Patience with who takes an answer slowly.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Instant, Sleep, sleep_until};

/// A stream to somebody who must take what is written.
///
/// The time that a write has to wait is a debt, which what was taken pays back at the least rate. Who takes nothing is
/// cut off after as long as the patience lasts, who takes less than the least rate some time later, and who keeps pace
/// never, even if a single write takes its time.
pub(super) struct Patience<S> {
    stream: S,
    most_debt: Duration,
    /// Bytes a second.
    least_rate: f64,
    debt: Duration,
    waiting: Option<Waiting>,
}

/// A write that waits since then, and what ends it.
struct Waiting {
    since: Instant,
    end: Pin<Box<Sleep>>,
}

impl<S> Patience<S> {
    pub(super) fn new(stream: S, most_debt: Duration, least_rate: u64) -> Self {
        Self { stream, most_debt, least_rate: least_rate.max(1) as f64, debt: Duration::ZERO, waiting: None }
    }

    /// What becomes of a write that came to `written`.
    fn judged(&mut self, written: Poll<io::Result<usize>>, context: &mut Context<'_>) -> Poll<io::Result<usize>> {
        let Poll::Ready(written) = written else {
            let left = self.most_debt.saturating_sub(self.debt);
            let waiting = self.waiting.get_or_insert_with(|| {
                let since = Instant::now();
                Waiting { since, end: Box::pin(sleep_until(since + left)) }
            });
            ready!(waiting.end.as_mut().poll(context));
            return Poll::Ready(Err(too_slow()));
        };
        if let Some(Waiting { since, .. }) = self.waiting.take() {
            self.debt += since.elapsed();
        }
        let paid = written.as_ref().map_or(0.0, |bytes| *bytes as f64 / self.least_rate);
        self.debt = self.debt.saturating_sub(Duration::from_secs_f64(paid));
        if self.debt > self.most_debt { Poll::Ready(Err(too_slow())) } else { Poll::Ready(written) }
    }
}

fn too_slow() -> io::Error {
    io::Error::new(io::ErrorKind::TimedOut, "the answer is taken too slowly")
}

impl<S: AsyncRead + Unpin> AsyncRead for Patience<S> {
    fn poll_read(self: Pin<&mut Self>, context: &mut Context<'_>, into: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().stream).poll_read(context, into)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Patience<S> {
    fn poll_write(self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        let written = Pin::new(&mut this.stream).poll_write(context, bytes);
        this.judged(written, context)
    }

    fn poll_write_vectored(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        pieces: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        let written = Pin::new(&mut this.stream).poll_write_vectored(context, pieces);
        this.judged(written, context)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().stream).poll_flush(context)
    }

    fn poll_shutdown(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.get_mut().stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use std::future::poll_fn;
    use std::io::{self, ErrorKind};
    use std::pin::Pin;
    use std::task::{Context, Poll, ready};
    use std::time::Duration;

    use tokio::io::AsyncWrite;
    use tokio::time::{Instant, Sleep, sleep};

    use super::Patience;

    const WAIT: Duration = Duration::from_millis(20);

    /// Takes ten bytes, and the next ten a while later.
    struct Drip(Pin<Box<Sleep>>);

    impl AsyncWrite for Drip {
        fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
            ready!(self.0.as_mut().poll(context));
            self.0.as_mut().reset(Instant::now() + WAIT);
            Poll::Ready(Ok(bytes.len().min(10)))
        }

        fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
            Poll::Ready(Ok(()))
        }

        fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
            Poll::Ready(Ok(()))
        }
    }

    /// How many of a hundred writes went through, and why there were no more.
    fn written(most_debt: Duration, least_rate: u64) -> (usize, Option<ErrorKind>) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        runtime.block_on(async {
            let mut stream = Patience::new(Drip(Box::pin(sleep(WAIT))), most_debt, least_rate);
            for count in 0..100 {
                let write = poll_fn(|context| Pin::new(&mut stream).poll_write(context, &[0; 64]));
                if let Err(error) = write.await {
                    return (count, Some(error.kind()));
                }
            }
            (100, None)
        })
    }

    #[test]
    fn who_takes_less_than_the_least_rate_is_cut_off_though_each_write_is_in_time() {
        // Ten bytes pay back a hundredth of a second, and each has to be waited for twice as long.
        let (count, error) = written(Duration::from_millis(500), 1000);
        assert_eq!(error, Some(ErrorKind::TimedOut));
        assert!((1..60).contains(&count), "after {count} writes");
    }

    #[test]
    fn who_takes_more_than_the_least_rate_is_never_cut_off() {
        assert_eq!(written(Duration::from_millis(500), 10), (100, None));
    }

    #[test]
    fn who_takes_nothing_is_cut_off_when_patience_ends() {
        assert_eq!(written(WAIT / 4, 1), (0, Some(ErrorKind::TimedOut)));
    }
}
