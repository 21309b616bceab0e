//! `chladni health`: one request, for container health checks where no curl is at hand.

use std::io::{Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use super::Failure;

/// Longest wait for each step of the request.
const TIMEOUT: Duration = Duration::from_secs(3);

/// Most bytes of an answer that are looked at: its first line.
const ANSWER_BYTES: u64 = 64;

/// Ask a running service whether it is alive.
#[derive(Debug, clap::Args)]
pub(crate) struct HealthArgs {
    /// Address of the service
    #[arg(default_value = "http://127.0.0.1:8080/livez")]
    url: String,
}

/// Succeeds if the service answers with a status of 200 to 299.
pub(crate) fn run(args: &HealthArgs) -> Result<(), Failure> {
    let (authority, path) = split(&args.url)?;
    let status =
        request(&authority, &path).map_err(|error| Failure::Other(format!("{}: {error}", args.url)))?;
    if (200..300).contains(&status) {
        return Ok(());
    }
    Err(Failure::Other(format!("{} answers {status}", args.url)))
}

/// Host with port, and path, of an `http` URL.
fn split(url: &str) -> Result<(String, String), Failure> {
    let refuse = || Failure::Input(format!("`{url}` is not an address; http://HOST:PORT/livez is one"));
    let rest = url.strip_prefix("http://").ok_or_else(refuse)?;
    let (authority, path) = rest.split_once('/').unwrap_or((rest, "livez"));
    if authority.is_empty() || url.contains(|c: char| c.is_whitespace() || c.is_control()) {
        return Err(refuse());
    }
    let has_port = authority.rsplit_once(':').is_some_and(|(_, port)| port.parse::<u16>().is_ok());
    let authority = if has_port { authority.to_owned() } else { format!("{authority}:80") };
    Ok((authority, format!("/{path}")))
}

fn request(authority: &str, path: &str) -> std::io::Result<u16> {
    let addresses = authority.to_socket_addrs()?;
    let mut failed = std::io::Error::other("the host has no address");
    for address in addresses {
        match TcpStream::connect_timeout(&address, TIMEOUT) {
            Ok(stream) => return ask(stream, authority, path),
            Err(error) => failed = error,
        }
    }
    Err(failed)
}

fn ask(mut stream: TcpStream, authority: &str, path: &str) -> std::io::Result<u16> {
    stream.set_read_timeout(Some(TIMEOUT))?;
    stream.set_write_timeout(Some(TIMEOUT))?;
    // In one piece: a server that answers after the first line would make the next write fail.
    let request = format!("GET {path} HTTP/1.1\r\nHost: {authority}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes())?;
    let mut answer = Vec::new();
    let mut limited = stream.take(ANSWER_BYTES);
    while !answer.contains(&b'\n') {
        let mut part = [0; ANSWER_BYTES as usize];
        let count = limited.read(&mut part)?;
        if count == 0 {
            break;
        }
        answer.extend_from_slice(&part[..count]);
    }
    let line = String::from_utf8_lossy(&answer);
    let status = line.strip_prefix("HTTP/1.").and_then(|rest| rest.split(' ').nth(1)?.trim().parse().ok());
    status.ok_or_else(|| std::io::Error::other("the answer is no HTTP"))
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader};
    use std::net::TcpListener;

    use super::*;

    /// Answers one request with these bytes; gives the request's first line. It reads the whole head first: closing
    /// with bytes unread would reset the connection, and the answer might never be seen.
    fn answered(answer: &'static str) -> (Result<(), Failure>, String) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/livez", listener.local_addr().unwrap());
        let server = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let head: Vec<String> = BufReader::new(&stream)
                .lines()
                .map(Result::unwrap)
                .take_while(|line| !line.is_empty())
                .collect();
            stream.write_all(answer.as_bytes()).unwrap();
            head[0].clone()
        });
        let result = run(&HealthArgs { url });
        (result, server.join().unwrap())
    }

    #[test]
    fn an_answer_of_success_is_health() {
        let (result, line) = answered("HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n");
        assert!(result.is_ok());
        assert_eq!(line, "GET /livez HTTP/1.1");
    }

    #[test]
    fn any_other_answer_is_a_failure_that_is_named() {
        assert!(
            answered("HTTP/1.1 503 Service Unavailable\r\n\r\n")
                .0
                .unwrap_err()
                .to_string()
                .ends_with("answers 503")
        );
        assert!(answered("SSH-2.0\r\n").0.unwrap_err().to_string().ends_with("no HTTP"));
        assert!(answered("").0.is_err());
    }

    #[test]
    fn addresses_are_taken_apart() {
        let parts = |url| split(url).map_err(|_| ());
        assert_eq!(parts("http://a:1/livez"), Ok(("a:1".into(), "/livez".into())));
        assert_eq!(parts("http://a"), Ok(("a:80".into(), "/livez".into())));
        assert_eq!(parts("http://[::1]:8080/readyz"), Ok(("[::1]:8080".into(), "/readyz".into())));
        for url in ["https://a/", "a:1", "http://", "http:// a/", "http://a/\r\nX: 1"] {
            assert_eq!(parts(url), Err(()), "{url}");
        }
    }

    #[test]
    fn a_port_where_nobody_listens_is_a_failure() {
        let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        assert!(run(&HealthArgs { url: format!("http://{address}/livez") }).is_err());
    }
}
