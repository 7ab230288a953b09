//! Verdicts to controllers, over Modbus TCP.
//!
//! Each station has a block of registers, the same for both reading functions. It begins with the current verdict, all
//! zero if there is none. Then comes the oldest unacknowledged verdict, until the controller writes its number into one
//! register. One request reads a block as it was at one moment.

use std::collections::BTreeMap;
use std::future::{Ready, ready};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use anyhow::{Context as _, Result};
use tapline_host::connection::{Slot, Slots, end_if_gone, listen};
use tapline_wire::now_ns;
use tokio::net::{TcpListener, TcpStream};
use tokio_modbus::server::Service;
use tokio_modbus::server::tcp::Server;
use tokio_modbus::{ExceptionCode, Request, Response};

use crate::config::wires::ModbusConfig;
use crate::shown::verdict::CasingVerdict;
use crate::wires::now::StationState;
use crate::wires::outbox::Receiver;
use crate::wires::wire::{News, Plant, Wire};

/// Most connections at once, and most of one machine: a display that loses its connections keeps no controller out.
const CONNECTIONS_MAX: usize = 32;
const OF_ONE_MAX: usize = 24;

/// Time until the next attempt after a connection could not be accepted.
const ACCEPT_AGAIN_AFTER: Duration = Duration::from_millis(200);

/// A connection whose other end has not answered for so long is ended.
const GONE_AFTER: Duration = Duration::from_secs(20);

/// Registers of a station's block.
const BLOCK: usize = 64;

/// The register within a block that controllers write.
const ACKNOWLEDGE: usize = 17;

/// Bytes of a casing's name, which fill half as many registers.
const NAME_BYTES: usize = 32;

/// The oldest verdict of a station that was not acknowledged.
#[derive(Debug)]
struct Waiting {
    /// The controller acknowledges it with this; never 0.
    number: u16,
    casing: u64,
    verdict: Arc<CasingVerdict>,
}

/// What is shown to each station's controller.
#[derive(Debug, Default)]
struct Mailbox {
    waiting: Option<Waiting>,
    /// Number of the last one.
    last_number: u16,
    acknowledged: u16,
}

/// All registers.
struct Registers {
    plant: Plant,
    mailboxes: Mutex<BTreeMap<u16, Mailbox>>,
}

/// Starts to serve the verdicts of `plant`; also returns where.
pub(super) fn start(config: &ModbusConfig, plant: &Plant) -> Result<(Wire, SocketAddr)> {
    let context = || format!("line.modbus.listen = \"{}\": cannot listen there", config.listen);
    let listener = listen(config.listen).with_context(context)?;
    let address = listener.local_addr().with_context(context)?;
    // Not the numbers of the last start: a controller may send again what it acknowledged then.
    let last_number = u16::try_from(now_ns() / 1_000_000_000 % 0xffff).unwrap_or(0);
    let mailbox = || Mailbox { last_number, ..Mailbox::default() };
    let mailboxes = plant.stations.iter().map(|&station| (station, mailbox())).collect();
    let registers = Registers { plant: plant.clone(), mailboxes: Mutex::new(mailboxes) };
    let wire = Wire::start(Receiver::Modbus, plant, || Ok(move |news| serve(listener, Arc::new(registers), news)))?;
    Ok((wire, address))
}

async fn serve(listener: std::net::TcpListener, registers: Arc<Registers>, mut news: News) -> Result<()> {
    let server = Server::new(TcpListener::from_std(listener)?);
    let (slots, has_warned) = (Slots::new(CONNECTIONS_MAX, OF_ONE_MAX), AtomicBool::new(false));
    let client = |stream: TcpStream, from: SocketAddr| {
        end_if_gone(&stream, GONE_AFTER);
        let slot = slots.take(from.ip());
        if slot.is_none() && !has_warned.swap(true, Ordering::Relaxed) {
            tracing::warn!(
                "modbus: {from} is refused: at most {CONNECTIONS_MAX} connections, {OF_ONE_MAX} of one machine"
            );
        }
        let client = slot.map(|slot| Client { registers: Arc::clone(&registers), _slot: slot });
        ready(Ok(client.map(|client| (client, stream))))
    };
    let accept = async {
        loop {
            let failed = |error| tracing::debug!(%error, "a controller has gone");
            if let Err(error) = server.serve(&client, failed).await {
                // Too many open files, for example.
                tracing::debug!(%error, "a controller cannot connect");
                tokio::time::sleep(ACCEPT_AGAIN_AFTER).await;
            }
        }
    };
    let fill = async {
        registers.fill();
        while news.next().await {
            registers.fill();
        }
    };
    tokio::select! {
        () = accept => {}
        () = fill => {}
    }
    Ok(())
}

/// A connection.
struct Client {
    registers: Arc<Registers>,
    _slot: Slot,
}

impl Service for Client {
    type Request = Request<'static>;
    type Response = Response;
    type Exception = ExceptionCode;
    type Future = Ready<Result<Response, ExceptionCode>>;

    fn call(&self, request: Request<'static>) -> Self::Future {
        let registers = &self.registers;
        ready(match request {
            Request::ReadHoldingRegisters(at, count) => registers.read(at, count).map(Response::ReadHoldingRegisters),
            Request::ReadInputRegisters(at, count) => registers.read(at, count).map(Response::ReadInputRegisters),
            Request::WriteSingleRegister(at, value) => {
                registers.write(at, value).map(|()| Response::WriteSingleRegister(at, value))
            }
            Request::WriteMultipleRegisters(at, values) => match *values {
                [value] => registers.write(at, value).map(|()| Response::WriteMultipleRegisters(at, 1)),
                _ => Err(ExceptionCode::IllegalDataAddress),
            },
            _ => Err(ExceptionCode::IllegalFunction),
        })
    }
}

impl Registers {
    fn mailboxes(&self) -> MutexGuard<'_, BTreeMap<u16, Mailbox>> {
        self.mailboxes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts the next verdict into each mailbox that has none.
    fn fill(&self) {
        let outbox = &self.plant.outbox;
        for &station in self.plant.stations.iter() {
            while self.mailboxes().get(&station).is_some_and(|mailbox| mailbox.waiting.is_none())
                && let Some(note) = outbox.next(Receiver::Modbus, Some(station))
            {
                // Read without the lock: a disk may be slow.
                let Some(verdict) = outbox.read(&note) else { continue };
                if let Some(mailbox) = self.mailboxes().get_mut(&station) {
                    mailbox.last_number = mailbox.last_number.checked_add(1).unwrap_or(1);
                    mailbox.waiting = Some(Waiting { number: mailbox.last_number, casing: note.number, verdict });
                }
            }
        }
    }

    fn read(&self, at: u16, count: u16) -> Result<Vec<u16>, ExceptionCode> {
        let (first, last) = (usize::from(at), usize::from(at) + usize::from(count));
        if count == 0 || last > self.plant.stations.len() * BLOCK {
            return Err(ExceptionCode::IllegalDataAddress);
        }
        let mut registers = Vec::with_capacity(last - first);
        for place in first / BLOCK..=(last - 1) / BLOCK {
            let start = place * BLOCK;
            let block = self.block(self.plant.stations[place]);
            registers.extend_from_slice(&block[first.max(start) - start..last.min(start + BLOCK) - start]);
        }
        Ok(registers)
    }

    /// The block of `station`, as docs/wires.md describes it.
    fn block(&self, station: u16) -> [u16; BLOCK] {
        let mut block = [0; BLOCK];
        let (station_state, judged_count) = self.plant.now.at(station);
        block[0] = station;
        if station_state != StationState::NoSignal {
            block[1] = self.heartbeat();
            block[2] = u16::from(station_state != StationState::Busy);
            block[3] = u16::from(station_state == StationState::Busy);
            block[7] = (judged_count & 0xffff) as u16;
        }
        if let StationState::Judged(verdict) = &station_state {
            block[3 + verdict.verdict.code() as usize] = 1;
        }
        if let Some(mailbox) = self.mailboxes().get(&station) {
            block[ACKNOWLEDGE] = mailbox.acknowledged;
            if let Some(waiting) = &mailbox.waiting {
                waiting.fill(&mut block);
            }
        }
        block
    }

    /// Counts while the line works, from 1 to 65535 and then from 1 again.
    fn heartbeat(&self) -> u16 {
        u16::try_from(self.plant.now.beats() % 0xffff).unwrap_or(0) + 1
    }

    fn write(&self, at: u16, value: u16) -> Result<(), ExceptionCode> {
        let (place, register) = (usize::from(at) / BLOCK, usize::from(at) % BLOCK);
        let station = self.plant.stations.get(place).filter(|_| register == ACKNOWLEDGE);
        let station = *station.ok_or(ExceptionCode::IllegalDataAddress)?;
        let mut mailboxes = self.mailboxes();
        let mailbox = mailboxes.get_mut(&station).ok_or(ExceptionCode::IllegalDataAddress)?;
        let acknowledged = mailbox.waiting.take_if(|waiting| waiting.number == value);
        match acknowledged {
            Some(acknowledged) => {
                mailbox.acknowledged = value;
                drop(mailboxes);
                self.plant.outbox.acknowledge(Receiver::Modbus, acknowledged.casing);
                self.fill();
                Ok(())
            }
            // The answer to the first time may have been lost.
            None if value == mailbox.acknowledged && value != 0 => Ok(()),
            None => Err(ExceptionCode::IllegalDataValue),
        }
    }
}

impl Waiting {
    fn fill(&self, block: &mut [u16; BLOCK]) {
        let verdict = &self.verdict;
        block[16] = self.number;
        block[18] = verdict.verdict.code() as u16;
        fill_number(&mut block[20..24], self.casing);
        fill_number(&mut block[24..28], verdict.at_ns.unsigned_abs() / 1_000_000);
        let mut name = [0; NAME_BYTES];
        let bytes = verdict.casing.as_bytes();
        let count = bytes.len().min(NAME_BYTES);
        name[..count].copy_from_slice(&bytes[..count]);
        for (register, pair) in block[28..].iter_mut().zip(name.as_chunks().0) {
            *register = u16::from_be_bytes(*pair);
        }
    }
}

/// Puts `number` into registers, the high ones first.
fn fill_number(registers: &mut [u16], number: u64) {
    for (register, pair) in registers.iter_mut().zip(number.to_be_bytes().as_chunks().0) {
        *register = u16::from_be_bytes(*pair);
    }
}
