//! A base station for many loggers at once: each line has a thread, and a connection to the one database of its own.
//!
//! A message is confirmed after its commit and not before; what cannot be stored is not confirmed, so the logger keeps it and sends it again.
//! There is nothing to shut down: killed at any moment, the next one goes on from the database.

use std::collections::HashMap;
use std::io;
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Result;
use spanwatch::session::packet::{Heartbeat, Hello, Welcome};
use spanwatch::session::{Device, Key};
use spanwatch::wire::message::{Answer, Notice, Request};

use super::console;
use super::line::{Desk, Kept, Line, new_series, now_ms};
use super::store::{Origin, Store};
use crate::channel::{Channel, Serial, Tcp};
use crate::keys::KeyFile;

/// A line is looked at so often.
const TURN: Duration = Duration::from_millis(100);
/// The same while somebody gives its logger orders.
const QUICK_TURN: Duration = Duration::from_millis(2);
/// An order that is not answered is sent again after this time, and then after twice as long, up to the longest.
const FIRST_ASK: Duration = Duration::from_secs(1);
const LONGEST_ASK: Duration = Duration::from_secs(10);
/// A serial device that is gone is opened again after this time.
const REOPEN: Duration = Duration::from_secs(5);

/// Something to tell a person, on the line `source` where it is on one.
#[derive(Debug, Clone, PartialEq)]
pub enum Said {
    /// A logger has proven who it is.
    Here {
        /// Which.
        logger: Device,
        /// What it is called.
        name: Option<String>,
        /// Line.
        source: String,
    },
    /// Somebody says that it is a logger whose key is not known here.
    Unknown {
        /// Which it says it is.
        logger: Device,
        /// By which key.
        key: u8,
        /// Line.
        source: String,
    },
    /// A message is stored.
    Stored {
        /// Whose.
        origin: Origin,
        /// What; none: it is of another version of the program, and stored as it came.
        notice: Option<Box<Notice>>,
    },
    /// Somebody with the console's key has given an order that changes something.
    Ordered {
        /// Whom.
        logger: Device,
        /// What.
        order: &'static str,
        /// Whether it was passed on.
        allowed: bool,
    },
    /// Messages that the logger has forgotten are not stored: they are lost.
    Lost {
        /// Whose.
        logger: Device,
        /// The number before them.
        after: u32,
        /// The last of them.
        upto: u32,
    },
    /// Something goes wrong on this side.
    Trouble {
        /// Line.
        source: String,
        /// What.
        what: String,
    },
    /// A line is closed.
    Closed {
        /// Line.
        source: String,
        /// Why.
        why: String,
    },
}

/// A request of somebody who gives orders through the base station, and where the answer goes.
pub(super) struct Order {
    pub(super) request: Request,
    pub(super) reply: Sender<Answer>,
}

/// What all threads of a base station share.
pub struct Base {
    pub(super) keys: KeyFile,
    pub(super) database: PathBuf,
    /// Where each logger takes orders, and the number of its line.
    loggers: Mutex<HashMap<Device, (u64, Sender<Order>)>>,
    lines: AtomicU64,
    /// How many give orders to each.
    consoles: Mutex<HashMap<Device, u32>>,
    said: Sender<Said>,
}

impl Base {
    /// A base station with the keys of `keys` and the database at `database`; what is said comes to the receiver.
    ///
    /// # Errors
    /// The keys cannot be read, or the database not be opened.
    pub fn new(keys: KeyFile, database: &Path) -> Result<(Arc<Self>, Receiver<Said>)> {
        keys.ring()?;
        Store::open(database)?;
        let (said, told) = mpsc::channel();
        let base = Self {
            keys,
            database: database.to_owned(),
            loggers: Mutex::default(),
            lines: AtomicU64::new(0),
            consoles: Mutex::default(),
            said,
        };
        Ok((Arc::new(base), told))
    }

    /// Attends to every logger that connects to `listener`.
    pub fn listen(self: &Arc<Self>, listener: TcpListener) {
        self.accept(listener, |base, line, source| {
            let why = match Tcp::new(line) {
                Ok(channel) => base.attend(Box::new(channel), &source),
                Err(error) => format!("{error:#}"),
            };
            base.say(Said::Closed { source, why });
        });
    }

    /// Takes orders from everyone who connects to `listener` and has the console's key.
    pub fn take_orders(self: &Arc<Self>, listener: TcpListener) {
        self.accept(listener, |base, line, source| {
            if let Err(error) = console::attend(&line, &base) {
                base.trouble(&format!("console {source}"), &format!("{error:#}"));
            }
        });
    }

    fn accept(self: &Arc<Self>, listener: TcpListener, attend: fn(Arc<Self>, TcpStream, String)) {
        let base = Arc::clone(self);
        thread::spawn(move || {
            loop {
                match listener.accept() {
                    Ok((line, from)) => {
                        let base = Arc::clone(&base);
                        thread::spawn(move || attend(base, line, from.to_string()));
                    }
                    // As of too many open files: others may close theirs.
                    Err(error) => {
                        base.trouble("listening", &error.to_string());
                        thread::sleep(TURN);
                    }
                }
            }
        });
    }

    /// Attends to the logger on a serial device, and opens it again when it is gone.
    pub fn attend_serial(self: &Arc<Self>, device: PathBuf) {
        let base = Arc::clone(self);
        thread::spawn(move || {
            let source = device.display().to_string();
            loop {
                let why = match Serial::open(&device) {
                    Ok(channel) => base.attend(Box::new(channel), &source),
                    Err(error) => format!("{error:#}"),
                };
                base.say(Said::Closed {
                    source: source.clone(),
                    why,
                });
                thread::sleep(REOPEN);
            }
        });
    }

    /// Attends to one logger until its line is gone; why it is.
    pub fn attend(&self, channel: Box<dyn Channel>, source: &str) -> String {
        let (orders, incoming) = mpsc::channel();
        let mut attendant = Attendant {
            line: Line::new(channel),
            desk: Counter {
                base: self,
                store: None,
                source,
                answer: None,
                key: 0,
                outdated: false,
            },
            id: self.lines.fetch_add(1, Ordering::Relaxed),
            orders,
            incoming,
            sessions: 0,
            logger: None,
            number: 0,
            open: None,
        };
        loop {
            if let Err(error) = attendant.turn() {
                let who = attendant
                    .logger
                    .map_or(String::new(), |logger| format!("logger {logger} is gone: "));
                return format!("{who}{error:#}");
            }
        }
    }

    pub(super) fn say(&self, said: Said) {
        // Nobody listens any more: the program ends.
        let _ = self.said.send(said);
    }

    pub(super) fn trouble(&self, source: &str, what: &str) {
        self.say(Said::Trouble {
            source: source.to_owned(),
            what: what.to_owned(),
        });
    }

    fn loggers(&self) -> MutexGuard<'_, HashMap<Device, (u64, Sender<Order>)>> {
        self.loggers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn consoles(&self) -> MutexGuard<'_, HashMap<Device, u32>> {
        self.consoles.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Somebody has begun to give a logger orders, or has ended.
    pub(super) fn count_console(&self, logger: Device, here: bool) {
        let mut consoles = self.consoles();
        let count = consoles.entry(logger).or_default();
        *count = if here { *count + 1 } else { count.saturating_sub(1) };
    }

    /// Hands an order to a logger; false: it is not here.
    pub(super) fn order(&self, logger: Device, order: Order) -> bool {
        match self.loggers().get(&logger) {
            Some((_, orders)) => orders.send(order).is_ok(),
            None => false,
        }
    }
}

/// Who attends to one line.
struct Attendant<'b> {
    line: Line,
    desk: Counter<'b>,
    /// Number of the line.
    id: u64,
    orders: Sender<Order>,
    incoming: Receiver<Order>,
    sessions: u32,
    logger: Option<Device>,
    /// Of the last request.
    number: u32,
    /// The order that is not answered yet.
    open: Option<Open>,
}

/// An order on its way: when it is sent again, and how long after that once more.
struct Open {
    order: Order,
    again: Instant,
    step: Duration,
}

impl Attendant<'_> {
    fn turn(&mut self) -> Result<()> {
        let quick = (self.logger).is_some_and(|logger| self.desk.base.consoles().get(&logger).is_some_and(|&c| c > 0));
        self.line.turn(if quick { QUICK_TURN } else { TURN }, &mut self.desk)?;
        if self.desk.outdated {
            anyhow::bail!("the logger's key was taken out of the file");
        }
        if self.line.sessions() != self.sessions {
            self.sessions = self.line.sessions();
            self.is_here();
            if let Some(open) = &mut self.open {
                open.again = Instant::now();
            }
        }
        // Asking twice does no harm.
        if let Some(open) = self.open.as_mut().filter(|open| Instant::now() >= open.again) {
            open.again = Instant::now() + open.step;
            open.step = (2 * open.step).min(LONGEST_ASK);
            self.line.request(self.number, &open.order.request)?;
        }
        match self.desk.answer.take() {
            Some((number, answer)) if number == self.number => {
                if let Some(open) = self.open.take() {
                    // Who has asked may be gone.
                    let _ = open.order.reply.send(answer);
                }
            }
            _ => {}
        }
        // The last order counts: whoever gave the one before has given it up, or asks again.
        for order in self.incoming.try_iter() {
            self.number = self.number.wrapping_add(1);
            self.line.request(self.number, &order.request)?;
            self.open = Some(Open {
                order,
                again: Instant::now() + FIRST_ASK,
                step: 2 * FIRST_ASK,
            });
        }
        Ok(())
    }

    /// The logger has proven who it is.
    fn is_here(&mut self) {
        let Some((logger, series)) = self.line.logger() else {
            return;
        };
        let Counter { base, source, .. } = self.desk;
        if self.logger != Some(logger) {
            self.leave();
            self.logger = Some(logger);
        }
        base.loggers().insert(logger, (self.id, self.orders.clone()));
        let name = base
            .keys
            .ring()
            .ok()
            .and_then(|ring| ring.name(logger).map(str::to_owned));
        let seen = (self.desk.store()).and_then(|store| store.seen(logger, name.as_deref(), series, source, now_ms()));
        if let Err(error) = seen {
            base.trouble(source, &format!("{error:#}"));
        }
        base.say(Said::Here {
            logger,
            name,
            source: source.to_owned(),
        });
    }

    fn leave(&mut self) {
        let Some(logger) = self.logger else { return };
        let mut loggers = self.desk.base.loggers();
        // It may have come back by another line.
        if loggers.get(&logger).is_some_and(|(line, _)| *line == self.id) {
            loggers.remove(&logger);
        }
    }
}

impl Drop for Attendant<'_> {
    fn drop(&mut self) {
        self.leave();
    }
}

/// What is stored, and answered, for one line.
struct Counter<'b> {
    base: &'b Base,
    /// None until it is first needed, and after it has failed.
    store: Option<Store>,
    source: &'b str,
    answer: Option<(u32, Answer)>,
    /// The key by which a session was offered last, and whether it is known no more.
    key: u8,
    outdated: bool,
}

impl Counter<'_> {
    fn store(&mut self) -> Result<&mut Store> {
        if self.store.is_none() {
            self.store = Some(Store::open(&self.base.database)?);
        }
        self.store
            .as_mut()
            .ok_or_else(|| anyhow::anyhow!("there is no database"))
    }

    /// Does something with the database; what fails is said, and the database opened anew the next time.
    fn with_store<T>(&mut self, work: impl FnOnce(&mut Store, &str) -> Result<T>) -> Option<T> {
        let source = self.source;
        match self.store().and_then(|store| work(store, source)) {
            Ok(done) => Some(done),
            Err(error) => {
                self.store = None;
                self.base.trouble(
                    source,
                    &format!("nothing is confirmed until it can be stored: {error:#}"),
                );
                None
            }
        }
    }
}

impl Desk for Counter<'_> {
    fn welcome(&mut self, hello: &Hello) -> Option<(Key, Welcome)> {
        let ring = match self.base.keys.ring() {
            Ok(ring) => ring,
            Err(error) => {
                self.base.trouble(self.source, &format!("{error:#}"));
                return None;
            }
        };
        let Some(key) = ring.find(hello.device, hello.key) else {
            self.base.say(Said::Unknown {
                logger: hello.device,
                key: hello.key,
                source: self.source.to_owned(),
            });
            return None;
        };
        let series = if hello.stream == 0 { new_series() } else { hello.stream };
        let stored = self.with_store(|store, _| store.stored(hello.device, series))?;
        let welcome = Welcome {
            stream: series,
            stored,
            time_ms: now_ms(),
        };
        self.key = hello.key;
        Some((key, welcome))
    }

    fn message(&mut self, origin: Origin, message: &[u8]) -> Kept {
        match self.with_store(|store, source| store.keep(origin, message, source, None, now_ms())) {
            None => Kept::No,
            Some(new) => {
                if new {
                    self.base.say(Said::Stored {
                        origin,
                        notice: postcard::from_bytes(message).ok().map(Box::new),
                    });
                }
                Kept::OnDisk
            }
        }
    }

    fn gap(&mut self, logger: Device, series: u32, after: u32, upto: u32) {
        self.with_store(|store, _| store.gap_detected(logger, series, after, upto, now_ms()));
    }

    fn lost(&mut self, logger: Device, series: u32, after: u32, upto: u32) -> bool {
        let written = self.with_store(|store, _| store.declare_lost(logger, series, after, upto, now_ms()));
        if written.is_some() {
            self.base.say(Said::Lost { logger, after, upto });
        }
        written.is_some()
    }

    fn heartbeat(&mut self, logger: Device, series: u32, heartbeat: &Heartbeat) {
        // A key that was taken out ends the session that was begun by it.
        self.outdated = matches!(self.base.keys.ring(), Ok(ring) if ring.find(logger, self.key).is_none());
        self.with_store(|store, _| store.heartbeat(logger, series, heartbeat, now_ms()));
    }

    fn answer(&mut self, number: u32, answer: Answer) {
        self.answer = Some((number, answer));
    }
}

/// A listener at `address`, or why there is none.
pub fn listener(address: &str) -> Result<TcpListener> {
    TcpListener::bind(address).map_err(|error: io::Error| match error.kind() {
        io::ErrorKind::AddrInUse => {
            anyhow::anyhow!("cannot listen at {address}: another program does; is it another base station?")
        }
        _ => anyhow::anyhow!("cannot listen at {address}: {error}"),
    })
}
