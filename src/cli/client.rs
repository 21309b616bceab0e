//! A small HTTP client: commands speak to their own service as anybody else would, through a socket.

use axum::body::{Body, Bytes, to_bytes};
use hyper::client::conn::http1::{SendRequest, handshake};
use hyper::{Method, Request, StatusCode, header};
use hyper_util::rt::TokioIo;
use serde_json::Value;
use tokio::net::TcpStream;

/// Largest answer that is taken.
const ANSWER_BYTES_MAX: usize = 1 << 30;

/// Why an exchange failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ClientError {
    /// No connection.
    #[error("cannot connect: {0}")]
    Connect(#[from] std::io::Error),
    /// The exchange broke off.
    #[error("the exchange broke off: {0}")]
    Http(#[from] hyper::Error),
    /// The answer broke off.
    #[error("the answer broke off: {0}")]
    Body(#[from] axum::Error),
    /// The request cannot be written.
    #[error("the request cannot be written: {0}")]
    Request(#[from] hyper::http::Error),
    /// The service refused.
    #[error("{method} {path} was answered with {status}: {detail}")]
    Refused {
        /// Of the request.
        method: Method,
        /// Of the request.
        path: String,
        /// Of the answer.
        status: StatusCode,
        /// What the service says.
        detail: String,
    },
    /// The answer is not JSON.
    #[error("the answer is not JSON: {0}")]
    Json(#[from] serde_json::Error),
}

/// One connection.
pub(crate) struct Client {
    sender: SendRequest<Body>,
    host: String,
}

impl Client {
    /// Connects to `host:port`.
    ///
    /// # Errors
    /// [`ClientError`].
    pub(crate) async fn connect(address: &str) -> Result<Self, ClientError> {
        let stream = TcpStream::connect(address).await?;
        let (sender, connection) = handshake(TokioIo::new(stream)).await?;
        tokio::spawn(async move {
            if let Err(error) = connection.await {
                tracing::debug!(%error, "the connection ended");
            }
        });
        Ok(Self { sender, host: address.to_owned() })
    }

    /// The body of a successful answer.
    ///
    /// # Errors
    /// [`ClientError`].
    pub(crate) async fn send(
        &mut self,
        method: Method,
        path: &str,
        content_type: Option<&str>,
        body: Vec<u8>,
    ) -> Result<Bytes, ClientError> {
        let mut request =
            Request::builder().method(method.clone()).uri(path).header(header::HOST, &self.host);
        if let Some(content_type) = content_type {
            request = request.header(header::CONTENT_TYPE, content_type);
        }
        self.sender.ready().await?;
        let answer = self.sender.send_request(request.body(Body::from(body))?).await?;
        let status = answer.status();
        let bytes = to_bytes(Body::new(answer.into_body()), ANSWER_BYTES_MAX).await?;
        if status.is_success() {
            return Ok(bytes);
        }
        let problem: Value = serde_json::from_slice(&bytes).unwrap_or_default();
        let detail = problem["detail"].as_str().unwrap_or("no reason given").to_owned();
        Err(ClientError::Refused { method, path: path.to_owned(), status, detail })
    }

    /// The bytes at `path`.
    ///
    /// # Errors
    /// [`ClientError`].
    pub(crate) async fn get(&mut self, path: &str) -> Result<Bytes, ClientError> {
        self.send(Method::GET, path, None, Vec::new()).await
    }

    /// The JSON at `path`.
    ///
    /// # Errors
    /// [`ClientError`].
    pub(crate) async fn json(&mut self, path: &str) -> Result<Value, ClientError> {
        Ok(serde_json::from_slice(&self.get(path).await?)?)
    }
}
