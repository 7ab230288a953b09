//! Who may see the line: on the loopback everyone on this machine, elsewhere those who have the token.

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context as _, Result, ensure};
use axum::http::header::{AUTHORIZATION, COOKIE, HOST, LOCATION, SET_COOKIE};
use axum::http::request::Parts;
use axum::http::{HeaderMap, Method, StatusCode, Uri};
use axum::response::{IntoResponse as _, Response};
use serde::Deserialize;
use tapline_host::connection::{is_this_machine, read_credentials};

use crate::serve::refuse;

/// Length of a token in bytes: a shorter one could be guessed.
const TOKEN_BYTES: std::ops::RangeInclusive<usize> = 16..=256;

/// Delay of the answer to a wrong token, so that guessing takes for ever.
const GUESS: Duration = Duration::from_secs(1);

/// Name of the cookie; it lasts for a year, as a screen on a wall does.
const COOKIE_NAME: &str = "tapline-line";
const COOKIE_FOR_S: u32 = 365 * 24 * 3600;

/// Paths needed to log in.
const OPEN_PATHS: [&str; 2] = ["/login", "/app.css"];

/// Who may see it.
pub(super) struct Access {
    /// `None` on the loopback, where none is asked for.
    token: Option<Token>,
}

/// What is kept of the token. Digests are compared in constant time.
struct Token {
    digest: blake3::Hash,
    /// What the cookie carries: whoever reads it does not learn the token.
    session: String,
}

/// What the form of the login sends.
#[derive(Deserialize)]
pub(super) struct Login {
    token: String,
}

impl Access {
    /// Access to what is served at `address`, for those who have the token in `token_file`.
    pub(super) fn new(address: SocketAddr, token_file: Option<&Path>) -> Result<Self> {
        let token = token_file.map(|path| Token::read(path).context("--serve-token-file")).transpose()?;
        ensure!(
            token.is_some() || address.ip().is_loopback(),
            "--serve {address}: other machines can reach this address, so a token is needed: write one of at least {} \
             characters into a file that nobody else can read, and give --serve-token-file FILE; or serve at 127.0.0.1:{}",
            TOKEN_BYTES.start(),
            address.port()
        );
        Ok(Self { token })
    }

    /// The refusal; `None` for those who may see the line.
    pub(super) async fn refusal(&self, request: &Parts) -> Option<Response> {
        let Some(token) = &self.token else { return refuse_other_host(&request.headers) };
        let path = request.uri.path();
        if OPEN_PATHS.contains(&path) || token.is_known(&request.headers) {
            return None;
        }
        let given = token_in(&request.uri);
        Some(match given {
            Some(given) => self.login(&Login { token: given }).await,
            None if path == "/" && request.method == Method::GET => see("/login").into_response(),
            None => {
                if request.headers.contains_key(AUTHORIZATION) {
                    tokio::time::sleep(GUESS).await;
                }
                refuse(
                    StatusCode::UNAUTHORIZED,
                    "a token is needed: log in at /login, or send the header Authorization: Bearer TOKEN".to_owned(),
                )
            }
        })
    }

    /// Answers a token that is sent: with a cookie, and a redirect to the page.
    pub(super) async fn login(&self, login: &Login) -> Response {
        let Some(token) = &self.token else { return see("/").into_response() };
        if !token.is(login.token.trim().as_bytes()) {
            tokio::time::sleep(GUESS).await;
            return see("/login?wrong").into_response();
        }
        let cookie = format!("{COOKIE_NAME}={}; Path=/; HttpOnly; SameSite=Lax; Max-Age={COOKIE_FOR_S}", token.session);
        ([(SET_COOKIE, cookie)], see("/")).into_response()
    }
}

impl Token {
    fn read(path: &Path) -> Result<Self> {
        let shown = path.display();
        let text = read_credentials(path)?;
        let text = text.trim();
        ensure!(
            TOKEN_BYTES.contains(&text.len()),
            "the token in {shown} has {} bytes: it must have {} to {}",
            text.len(),
            TOKEN_BYTES.start(),
            TOKEN_BYTES.end()
        );
        ensure!(
            text.bytes().all(|byte| byte.is_ascii_graphic()),
            "the token in {shown} holds a space or a character that is not ASCII: headers cannot carry it"
        );
        Ok(Self::new(text))
    }

    fn new(text: &str) -> Self {
        let session =
            blake3::Hash::from(blake3::derive_key("tapline 2026 cookie of the page of a line", text.as_bytes()));
        Self { digest: blake3::hash(text.as_bytes()), session: session.to_hex().to_string() }
    }

    /// Whether `text` is the token; the time this takes does not depend on where they differ.
    fn is(&self, text: &[u8]) -> bool {
        blake3::hash(text) == self.digest
    }

    /// Whether a request carries the token, or the cookie of a client that has sent it before.
    fn is_known(&self, headers: &HeaderMap) -> bool {
        let bearer = headers.get(AUTHORIZATION).and_then(|value| value.as_bytes().strip_prefix(b"Bearer "));
        let cookies = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut cookies = cookies.flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
        let is_session = |session: &str| blake3::hash(session.as_bytes()) == blake3::hash(self.session.as_bytes());
        bearer.is_some_and(|token| self.is(token))
            || cookies.any(|(name, session)| name == COOKIE_NAME && is_session(session))
    }
}

/// The token in an address that ends in `?token=...`.
fn token_in(uri: &Uri) -> Option<String> {
    axum::extract::Query::<Login>::try_from_uri(uri).ok().map(|query| query.0.token)
}

/// A redirect to another path, which the browser follows with GET.
fn see(path: &'static str) -> (StatusCode, [(axum::http::HeaderName, &'static str); 1]) {
    (StatusCode::SEE_OTHER, [(LOCATION, path)])
}

/// Refuses requests for a host other than this machine: a page from elsewhere can make its name resolve to the
/// loopback, to read what is served there.
fn refuse_other_host(headers: &HeaderMap) -> Option<Response> {
    let host = headers.get(HOST).and_then(|value| value.to_str().ok()).unwrap_or_default();
    if is_at_this_machine(host) {
        return None;
    }
    let why =
        "this page is only for this machine: open it as 127.0.0.1 or localhost, or have the line serve it with a token";
    Some(refuse(StatusCode::FORBIDDEN, why.to_owned()))
}

/// Whether `host`, with its port or without, is this machine.
fn is_at_this_machine(host: &str) -> bool {
    let is_port = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let name = host.rsplit_once(':').filter(|(_, port)| is_port(port)).map_or(host, |(name, _)| name);
    is_this_machine(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a name from elsewhere that is taken for this machine's, and a name of this machine that is not.
    #[test]
    fn only_names_of_the_loopback_are_this_machine() {
        for host in ["127.0.0.1:8088", "127.0.0.1", "localhost:1", "LOCALHOST", "[::1]:8088", "127.3.2.1:80"] {
            assert!(is_at_this_machine(host), "{host}");
        }
        for host in [
            "", "evil.example", "evil.example:8088", "127.0.0.1.evil.example", "localhost.evil:80", "10.0.0.1",
            "[::2]:1",
        ] {
            assert!(!is_at_this_machine(host), "{host}");
        }
    }

    /// Catches a token that is not required where others can reach the page, a token that others can guess or read, and
    /// an error that does not say so.
    #[test]
    fn an_address_that_others_can_reach_needs_a_token() {
        use std::fs;
        use std::os::unix::fs::PermissionsExt as _;

        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("token");
        let open = SocketAddr::from(([0, 0, 0, 0], 8088));
        let said = |result: Result<Access>| format!("{:#}", result.err().unwrap());
        let none = said(Access::new(open, None));
        assert!(none.contains("0.0.0.0:8088") && none.contains("--serve-token-file"), "{none}");
        for address in ["127.0.0.1:8088", "[::1]:8088"] {
            assert!(Access::new(address.parse().unwrap(), None).unwrap().token.is_none());
        }
        for (text, mode, why) in [
            ("short", 0o600, "has 5 bytes"),
            ("with a space in its middle", 0o600, "a space"),
            ("0123456789abcdef", 0o644, "every user"),
        ] {
            fs::write(&file, text).unwrap();
            fs::set_permissions(&file, fs::Permissions::from_mode(mode)).unwrap();
            let said = said(Access::new(open, Some(&file)));
            assert!(said.contains(why) && said.contains("token"), "{said}");
        }
        fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).unwrap();
        assert!(Access::new(open, Some(&file)).unwrap().token.is_some());
    }

    /// Catches a request without the token that is answered, and a cookie that carries the token itself.
    #[test]
    fn a_request_is_known_by_its_token_or_its_cookie() {
        let token = Token::new("0123456789abcdef");
        let is_known = |name, value: &str| {
            let mut headers = HeaderMap::new();
            headers.insert(name, value.parse().unwrap());
            token.is_known(&headers)
        };
        assert!(is_known(AUTHORIZATION, "Bearer 0123456789abcdef"));
        assert!(is_known(COOKIE, &format!("other=1; {COOKIE_NAME}={}", token.session)));
        assert!(!token.session.contains("0123456789abcdef"));
        for (name, value) in [
            (AUTHORIZATION, "Bearer 0123456789abcdee"),
            (AUTHORIZATION, "Bearer "),
            (AUTHORIZATION, "0123456789abcdef"),
            (COOKIE, "tapline-line=0123456789abcdef"),
            (COOKIE, "tapline-line="),
        ] {
            assert!(!is_known(name, value), "{value}");
        }
        assert!(!token.is_known(&HeaderMap::new()));
    }
}
