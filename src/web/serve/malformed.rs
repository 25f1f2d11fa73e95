//! Adds our headers to hyper's own 400.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

use crate::web::http::headers;

/// A connection. Until a request came to the router, what is written is the library's own refusal.
#[derive(Debug)]
pub struct WithHeaders<S> {
    stream: S,
    is_asked: Arc<AtomicBool>,
    secure: bool,
    /// What is still to be written of a refusal.
    rest: Vec<u8>,
}

impl<S> WithHeaders<S> {
    /// `is_asked` turns true with the first request that comes to the router; `secure` tells of TLS.
    pub fn new(stream: S, is_asked: Arc<AtomicBool>, secure: bool) -> WithHeaders<S> {
        WithHeaders { stream, is_asked, secure, rest: Vec::new() }
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for WithHeaders<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for WithHeaders<S> {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let WithHeaders { stream, is_asked, secure, rest } = &mut *self;
        if is_asked.load(Ordering::Relaxed) {
            return Pin::new(stream).poll_write(cx, bytes);
        }
        if rest.is_empty() {
            *rest = headers::with_headers(bytes, *secure);
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

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        if self.is_asked.load(Ordering::Relaxed) {
            return Pin::new(&mut self.stream).poll_write_vectored(cx, slices);
        }
        let first = slices.iter().find(|slice| !slice.is_empty());
        first.map_or(Poll::Ready(Ok(0)), |slice| self.poll_write(cx, slice))
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}
