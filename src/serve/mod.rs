//! The page of a running line, its metrics and its health over HTTP.
//!
//! It is one more viewer of the line's status. It runs on a thread of its own, which gets each new status and
//! keeps only the newest: slow clients, or many of them, do not affect the line.
//!
//! - here: the thread, its connections, and the answer at each path
//! - `access`: who may see the line
//! - `metrics`: numbers for Prometheus
//! - `reports`: the reports of the last casings

mod access;
mod metrics;
mod reports;

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use anyhow::{Context as _, Result};
use axum::extract::{DefaultBodyLimit, Form, FromRequest as _, Query, Request, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderValue, StatusCode};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::sse::{Event, Sse};
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use axum::{BoxError, Router};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use maud::html;
use tapline_host::connection::{Slots, end_if_gone, listen};
use tapline_wire::{Reasons, now_ns};
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, watch};
use tokio_stream::StreamExt as _;
use tokio_stream::wrappers::WatchStream;

use crate::config::report::ReportConfig;
use crate::serve::access::{Access, Login};
use crate::serve::reports::Wanted;
use crate::shown::status::Status;

/// Most connections at once, and most of one machine; browsers ask again.
const CONNECTIONS_MAX: usize = 64;
const OF_ONE_MAX: usize = 48;

/// Most of them that follow the line.
const FOLLOWERS_MAX: usize = 16;

/// How long a client may take to send the head of a request.
const HEAD_WITHIN: Duration = Duration::from_secs(10);

/// How long a client may take to send its token, and most bytes of it with its name.
const LOGIN_WITHIN: Duration = Duration::from_secs(10);
const LOGIN_BYTES_MAX: usize = 4096;

/// A client that has received nothing for so long is gone.
const GONE_AFTER: Duration = Duration::from_secs(30);

/// How long clients have to receive the last status, and reports to end.
const END_WITHIN: Duration = Duration::from_millis(300);

/// A line that has sent no status for so long hangs: it sends one every second.
const SILENT_AFTER_NS: i64 = 5_000_000_000;

/// What browsers may do with the answers: load the page's own script and style, and nothing else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; \
                      form-action 'self'; base-uri 'none'; frame-ancestors 'none'";

/// A status as text; empty before the first.
type Shown = Arc<str>;

/// Serves the page until it is dropped.
#[derive(Debug)]
pub(crate) struct Server {
    /// `None` once this is dropped.
    statuses: Option<watch::Sender<Shown>>,
    url: String,
    thread: Option<JoinHandle<()>>,
}

/// What all answers are made of.
#[derive(Clone)]
struct App {
    /// The page, before anything is known of the line.
    page: Arc<str>,
    statuses: watch::Receiver<Shown>,
    access: Arc<Access>,
    followers: Arc<Semaphore>,
    /// Allows one report to be made at a time.
    reports: Arc<Semaphore>,
    /// Whether the disk is asked for its free space.
    is_room_asked: Arc<AtomicBool>,
}

impl Server {
    /// Listens at `address`, for those who have the token in `token_file`, or on the loopback for everyone. `printed` names
    /// the line, and says how angles on a casing are counted.
    pub(crate) fn start(address: SocketAddr, token_file: Option<&Path>, printed: &ReportConfig) -> Result<Self> {
        let access = Arc::new(Access::new(address, token_file)?);
        let listener = listen(address).with_context(|| format!("--serve: cannot listen at {address}"))?;
        let url = format!("http://{}", listener.local_addr().context("--serve")?);
        let (sender, statuses) = watch::channel(Shown::from(""));
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .thread_name("serve-files")
            .max_blocking_threads(2)
            .build()
            .context("--serve: cannot start")?;
        let followers = Arc::new(Semaphore::new(FOLLOWERS_MAX));
        let meanings: BTreeMap<&str, String> = Reasons::ALL.iter().map(|&(of, name)| (name, of.meaning())).collect();
        let meanings = serde_json::to_string(&meanings).context("--serve")?;
        let page = include_str!("page/index.html")
            .replace("{angles}", &html! { (printed.angles()) }.into_string())
            .replace("{reasons}", &html! { (meanings) }.into_string())
            .replace("{place}", &html! { (printed.place()) }.into_string())
            .into();
        let (reports, is_room_asked) = (Arc::new(Semaphore::new(1)), Arc::default());
        let app = App { page, statuses, access, followers, reports, is_room_asked };
        let serve = move || {
            if let Err(error) = runtime.block_on(serve(listener, app)) {
                tracing::error!("the page of the line is not served: {error}");
            }
            runtime.shutdown_timeout(END_WITHIN);
        };
        let thread = Builder::new().name("serve".to_owned()).spawn(serve).context("cannot start the thread serve")?;
        Ok(Self { statuses: Some(sender), url, thread: Some(thread) })
    }

    /// The page's address.
    pub(crate) fn url(&self) -> String {
        self.url.clone()
    }

    /// Passes a new status to all viewers, without waiting for them; whether the page is still served.
    pub(crate) fn show(&self, status: &str) -> bool {
        self.statuses.iter().for_each(|statuses| drop(statuses.send_replace(status.into())));
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // Its streams end with the last status.
        drop(self.statuses.take());
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

async fn serve(listener: std::net::TcpListener, app: App) -> std::io::Result<()> {
    let listener = TcpListener::from_std(listener)?;
    let slots = Slots::new(CONNECTIONS_MAX, OF_ONE_MAX);
    let mut statuses = app.statuses.clone();
    let ended = async { while statuses.changed().await.is_ok() {} };
    tokio::pin!(ended);
    let router = router(app);
    loop {
        let (stream, from) = tokio::select! {
            accepted = listener.accept() => match accepted {
                Ok(accepted) => accepted,
                Err(error) => {
                    // Too many open files, for example.
                    tracing::debug!(%error, "a viewer cannot connect");
                    tokio::time::sleep(Duration::from_millis(200)).await;
                    continue;
                }
            },
            () = &mut ended => break,
        };
        let Some(slot) = slots.take(from.ip()) else {
            tracing::debug!(
                "{from} is refused: at most {CONNECTIONS_MAX} viewers' connections, {OF_ONE_MAX} of one machine"
            );
            continue;
        };
        end_if_gone(&stream, GONE_AFTER);
        let service = TowerToHyperService::new(router.clone());
        tokio::spawn(async move {
            let mut http = hyper::server::conn::http1::Builder::new();
            let http = http.timer(TokioTimer::new()).header_read_timeout(HEAD_WITHIN);
            if let Err(error) = http.serve_connection(TokioIo::new(stream), service).await {
                tracing::debug!(%error, "a viewer has gone");
            }
            drop(slot);
        });
    }
    tokio::time::sleep(END_WITHIN).await;
    Ok(())
}

fn router(app: App) -> Router {
    let file = |kind: &'static str, text: &'static str| get(async move || ([(CONTENT_TYPE, kind)], text));
    Router::new()
        .route("/", get(index))
        .route("/app.js", file("text/javascript; charset=utf-8", include_str!("page/app.js")))
        .route("/app.css", file("text/css; charset=utf-8", include_str!("page/app.css")))
        .route(
            "/login",
            file("text/html; charset=utf-8", include_str!("page/login.html"))
                .post(login)
                .layer(DefaultBodyLimit::max(LOGIN_BYTES_MAX)),
        )
        .route("/events", get(events))
        .route("/report", get(report))
        .route("/metrics", get(numbers))
        .route("/healthz", get(health))
        .layer(from_fn_with_state(app.clone(), guard))
        .with_state(app)
}

/// Answers those who may see the line, with headers that say what browsers may do with the answer.
async fn guard(State(app): State<App>, request: Request, next: Next) -> Response {
    let (head, body) = request.into_parts();
    let mut answer = match app.access.refusal(&head).await {
        None => next.run(Request::from_parts(head, body)).await,
        Some(refusal) => refusal,
    };
    let fixed = [
        (CONTENT_SECURITY_POLICY, POLICY),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (CACHE_CONTROL, "no-store"),
        (REFERRER_POLICY, "no-referrer"),
    ];
    for (name, value) in fixed {
        answer.headers_mut().entry(name).or_insert(HeaderValue::from_static(value));
    }
    answer
}

async fn index(State(app): State<App>) -> Response {
    ([(CONTENT_TYPE, "text/html; charset=utf-8")], app.page.to_string()).into_response()
}

async fn login(State(app): State<App>, request: Request) -> Response {
    // Whoever sends nothing more would keep one of the connections.
    match tokio::time::timeout(LOGIN_WITHIN, Form::<Login>::from_request(request, &())).await {
        Ok(Ok(Form(login))) => app.access.login(&login).await,
        Ok(Err(refusal)) => refusal.into_response(),
        Err(_) => {
            let why = format!("the token has not come within {} s", LOGIN_WITHIN.as_secs());
            refuse(StatusCode::REQUEST_TIMEOUT, why)
        }
    }
}

/// Every new status, as server-sent events; a slow client misses some.
async fn events(State(app): State<App>) -> Response {
    let Ok(place) = Arc::clone(&app.followers).try_acquire_owned() else {
        return refuse(StatusCode::SERVICE_UNAVAILABLE, format!("{FOLLOWERS_MAX} pages follow this line already"));
    };
    let statuses = WatchStream::new(app.statuses).filter(|status| !status.is_empty()).map(move |status| {
        let _until_the_stream_ends = &place;
        Ok::<_, Infallible>(Event::default().data(status))
    });
    Sse::new(statuses).into_response()
}

async fn report(State(app): State<App>, Query(wanted): Query<Wanted>) -> Response {
    let status = app.status().unwrap_or_default();
    reports::page(&app.reports, &status, wanted).await
}

async fn numbers(State(app): State<App>) -> Response {
    let Some(status) = app.status() else {
        return refuse(StatusCode::SERVICE_UNAVAILABLE, "the line starts".to_owned());
    };
    let free_bytes = metrics::free_bytes(Arc::clone(&app.is_room_asked), status.out.clone()).await;
    match metrics::text(&status, free_bytes) {
        Ok(text) => ([(CONTENT_TYPE, metrics::CONTENT)], text).into_response(),
        Err(error) => refuse(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()),
    }
}

/// 200 while the line works, otherwise 503 with the reasons.
async fn health(State(app): State<App>) -> Response {
    let Some(status) = app.status() else {
        return refuse(StatusCode::SERVICE_UNAVAILABLE, "the line starts".to_owned());
    };
    let mut troubles = status.troubles;
    let age_ns = now_ns().saturating_sub(status.at_ns);
    if age_ns > SILENT_AFTER_NS {
        troubles.push(format!("the line has shown nothing for {} s", age_ns / 1_000_000_000));
    }
    match troubles.as_slice() {
        [] => "ok\n".into_response(),
        _ => refuse(StatusCode::SERVICE_UNAVAILABLE, troubles.join("\n")),
    }
}

impl App {
    /// The newest status; `None` before the first.
    fn status(&self) -> Option<Status> {
        serde_json::from_str(&self.statuses.borrow()).ok()
    }
}

/// An answer that gives the reason in one line.
fn refuse(code: StatusCode, why: String) -> Response {
    (code, format!("{why}\n")).into_response()
}

/// Runs `work`, which may wait for a disk, on another thread; an error if it fails or takes longer than `patience`.
async fn beside<T: Send + 'static>(
    patience: Duration,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, BoxError> {
    Ok(tokio::time::timeout(patience, tokio::task::spawn_blocking(work)).await??)
}
