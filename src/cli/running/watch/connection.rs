//! The stream of snapshots: opened, read, and opened again when it breaks off.

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, bail};
use axum::http::StatusCode;
use futures_util::StreamExt as _;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{WebSocketStream, client_async_with_config};

use super::server::{Server, Session, Stream};

/// The waits between two attempts: the first, and the longest.
const AGAIN_FIRST: Duration = Duration::from_millis(100);
const AGAIN_MAX: Duration = Duration::from_millis(1600);
/// The server answers the opening of a socket at once.
const OPEN_WITHIN: Duration = Duration::from_secs(2);
/// A connection on which nothing comes, not even a ping, is dead. The server pings each second.
const SILENT_MAX: Duration = Duration::from_secs(5);
/// Messages that may wait to be shown. A slow terminal holds the stream back; the server then skips states.
const NEWS_MAX: usize = 4;
/// The largest message: more than the server's own bound for a snapshot.
const MESSAGE_BYTES_MAX: usize = 32 << 20;

/// What comes of the connection.
#[derive(Debug)]
pub enum News {
    Connected,
    Message(String),
    /// It broke off, and is opened again.
    Lost,
    /// The server wants no further attempt, and why.
    Refused(String),
}

/// An open stream.
pub struct Connection {
    server: Arc<Server>,
    session: Session,
    is_whole: bool,
    socket: WebSocketStream<Stream>,
}

/// The end of a session at the server.
pub struct Leaving {
    server: Arc<Server>,
    session: Session,
    reading: JoinHandle<()>,
}

impl Leaving {
    pub async fn leave(self) {
        self.reading.abort();
        self.server.leave(&self.session).await;
    }
}

/// Why there is no stream.
enum NotOpened {
    /// Another attempt may succeed.
    Unreached(anyhow::Error),
    Refused(String),
}

impl Connection {
    /// Opens the stream for the first time: of whole snapshots, or of changes.
    ///
    /// # Errors
    /// If that does not succeed. Later the connection is opened again; a wrong address is told at once.
    pub async fn open(server: Server, session: Session, is_whole: bool) -> anyhow::Result<Connection> {
        match open(&server, &session, is_whole).await {
            Ok(socket) => Ok(Connection { server: Arc::new(server), session, is_whole, socket }),
            Err(NotOpened::Unreached(error)) => Err(error),
            Err(NotOpened::Refused(why)) => bail!(why),
        }
    }

    /// Reads it in a task until it is left.
    pub fn start(self) -> (mpsc::Receiver<News>, Leaving) {
        let (tell, news) = mpsc::channel(NEWS_MAX);
        let (server, session) = (self.server.clone(), self.session.clone());
        let reading = tokio::spawn(async move {
            let Connection { server, session, is_whole, mut socket } = self;
            loop {
                let refused = read(&mut socket, &tell).await;
                drop(socket);
                let news = refused.map_or(News::Lost, News::Refused);
                if tell.send(news).await.is_err() {
                    return;
                }
                socket = match open_again(&server, &session, is_whole).await {
                    Ok(socket) => socket,
                    Err(why) => {
                        // The watcher may have gone.
                        let _ = tell.send(News::Refused(why)).await;
                        return;
                    }
                };
            }
        });
        (news, Leaving { server, session, reading })
    }
}

/// Opens the stream as soon as that is possible, or says why it never will be.
async fn open_again(
    server: &Server,
    session: &Session,
    is_whole: bool,
) -> Result<WebSocketStream<Stream>, String> {
    let mut wait = AGAIN_FIRST;
    loop {
        sleep(wait).await;
        wait = (wait * 2).min(AGAIN_MAX);
        match open(server, session, is_whole).await {
            Ok(socket) => return Ok(socket),
            Err(NotOpened::Unreached(_)) => {}
            Err(NotOpened::Refused(why)) => return Err(why),
        }
    }
}

async fn open(
    server: &Server,
    session: &Session,
    is_whole: bool,
) -> Result<WebSocketStream<Stream>, NotOpened> {
    let query = if is_whole { "" } else { "?deltas" };
    let request = server.stream_request(session, query).map_err(NotOpened::Unreached)?;
    let stream = server.connect().await.map_err(NotOpened::Unreached)?;
    let bounds = WebSocketConfig::default()
        .max_message_size(Some(MESSAGE_BYTES_MAX))
        .max_frame_size(Some(MESSAGE_BYTES_MAX));
    let opened = timeout(OPEN_WITHIN, client_async_with_config(request, stream, Some(bounds))).await;
    let opened = opened.with_context(|| format!("{} does not open the stream in time", server.url));
    match opened.map_err(NotOpened::Unreached)? {
        Ok((socket, _)) => Ok(socket),
        Err(Error::Http(answer)) => Err(match answer.status() {
            StatusCode::UNAUTHORIZED => NotOpened::Refused(
                "the session or the token is not, or no longer, valid. Log in again, or make a token with \
                 `telltale user token`"
                    .to_owned(),
            ),
            status if status.is_server_error() || status == StatusCode::TOO_MANY_REQUESTS => {
                NotOpened::Unreached(anyhow::anyhow!("{} answers {status}", server.url))
            }
            status => NotOpened::Refused(format!("{} refuses the stream: {status}", server.url)),
        }),
        Err(error) => Err(NotOpened::Unreached(
            anyhow::Error::new(error).context(format!("{} opens no stream", server.url)),
        )),
    }
}

/// Hands on what comes until the socket ends. Returns why if it will not be opened again.
async fn read(socket: &mut WebSocketStream<Stream>, tell: &mpsc::Sender<News>) -> Option<String> {
    if tell.send(News::Connected).await.is_err() {
        return None;
    }
    while let Ok(Some(Ok(message))) = timeout(SILENT_MAX, socket.next()).await {
        match message {
            Message::Text(text) => tell.send(News::Message(text.as_str().to_owned())).await.ok()?,
            Message::Close(Some(frame)) if frame.code == CloseCode::Policy => {
                return Some("the server has ended the session. Log in again".to_owned());
            }
            Message::Close(_) => return None,
            _ => {}
        }
    }
    None
}
