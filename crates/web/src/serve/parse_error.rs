//! Adds our headers to hyper's own 400 for a malformed request. It comes before any request, so it is the
//! first thing that is written on such a connection.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, ready};

use tokio::io::AsyncWrite;

use crate::http::headers;

/// The writing half of a connection. Until a request reaches the router, the only bytes written are hyper's own 400.
#[derive(Debug)]
pub struct WithHeaders<W> {
    stream: W,
    /// Turns true with the first request that comes to the router.
    has_request: Arc<AtomicBool>,
    is_tls: bool,
    /// The part of the 400 that is not written yet.
    rest: Vec<u8>,
}

impl<W> WithHeaders<W> {
    pub fn new(stream: W, has_request: Arc<AtomicBool>, is_tls: bool) -> WithHeaders<W> {
        WithHeaders { stream, has_request, is_tls, rest: Vec::new() }
    }
}

impl<W: AsyncWrite + Unpin> AsyncWrite for WithHeaders<W> {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let WithHeaders { stream, has_request, is_tls, rest } = &mut *self;
        if has_request.load(Ordering::Relaxed) {
            return Pin::new(stream).poll_write(cx, bytes);
        }
        if rest.is_empty() {
            *rest = headers::with_headers(bytes, *is_tls);
        }
        while !rest.is_empty() {
            let written = ready!(Pin::new(&mut *stream).poll_write(cx, rest))?;
            if written == 0 {
                return Poll::Ready(Err(io::ErrorKind::WriteZero.into()));
            }
            rest.drain(..written);
        }
        Poll::Ready(Ok(bytes.len()))
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}
