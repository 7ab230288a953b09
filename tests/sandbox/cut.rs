//! A connection that breaks at a chosen word: what the client has sent arrives, and no answer comes back.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::thread;
use std::time::Duration;

/// Nothing has happened yet; the word was sent, and no answer comes back; the connection was cut, later ones are not.
const WHOLE: u8 = 0;
const SILENT: u8 = 1;
const CUT: u8 = 2;

/// Passes on connections to a server, and cuts the first that sends a word.
pub(crate) struct Cut {
    state: Arc<AtomicU8>,
    /// Where it listens.
    pub address: String,
}

impl Cut {
    /// Listens for connections to `server`, and cuts the one that sends `word` first.
    pub(crate) fn at(server: &str, word: &'static str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let state = Arc::new(AtomicU8::new(WHOLE));
        let (server, of_all) = (server.to_owned(), Arc::clone(&state));
        start(move || {
            for client in listener.incoming().flatten() {
                let Ok(server) = TcpStream::connect(&server) else { continue };
                let (back_from, back_to) = (server.try_clone().unwrap(), client.try_clone().unwrap());
                let state = Arc::clone(&of_all);
                start(move || back(back_from, back_to, &state));
                let state = Arc::clone(&of_all);
                start(move || forth(client, server, word, &state));
            }
        });
        Self { state, address }
    }

    /// Whether a connection was cut.
    pub(crate) fn is_done(&self) -> bool {
        self.state.load(Ordering::SeqCst) == CUT
    }
}

fn start(work: impl FnOnce() + Send + 'static) {
    drop(thread::Builder::new().name("cut".to_owned()).spawn(work).unwrap());
}

fn forth(mut client: TcpStream, mut server: TcpStream, word: &str, state: &AtomicU8) {
    let mut buffer = vec![0; 1 << 16];
    while let Ok(count) = client.read(&mut buffer)
        && count > 0
    {
        let has_word = buffer[..count].windows(word.len()).any(|part| part == word.as_bytes());
        let is_cut = has_word && state.compare_exchange(WHOLE, SILENT, Ordering::SeqCst, Ordering::SeqCst).is_ok();
        if server.write_all(&buffer[..count]).is_err() {
            break;
        }
        if is_cut {
            // Time for the server to take it.
            thread::sleep(Duration::from_millis(300));
            state.store(CUT, Ordering::SeqCst);
            break;
        }
    }
    // Both ends may be gone already.
    drop((client.shutdown(Shutdown::Both), server.shutdown(Shutdown::Both)));
}

fn back(mut server: TcpStream, mut client: TcpStream, state: &AtomicU8) {
    let mut buffer = vec![0; 1 << 16];
    while let Ok(count) = server.read(&mut buffer)
        && count > 0
    {
        if state.load(Ordering::SeqCst) != SILENT && client.write_all(&buffer[..count]).is_err() {
            break;
        }
    }
}
