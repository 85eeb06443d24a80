//! A logger on this PC: what the firmware's image is on a board.
//!
//! Its flash has the layout that the image's has in QEMU, in memory or in a file that outlives it.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use anyhow::{Context, Result, anyhow};
use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use spanwatch::link::{Board, Health, RemoteLogger};
use spanwatch::settings::Identity;

/// Bytes of a page.
const PAGE_BYTES: usize = 4096;
/// Pages of the outbox, and behind them those of the settings: as in the image.
const OUTBOX_PAGES: usize = 16;
const SETTINGS_PAGES: usize = 6;
/// Bytes of both.
const FLASH_BYTES: usize = (OUTBOX_PAGES + SETTINGS_PAGES) * PAGE_BYTES;

/// The cells of a flash, and the file that keeps them.
struct Cells {
    bytes: Vec<u8>,
    file: Option<File>,
}

/// Opens a file for a logger's flash, or makes it: nobody but its owner can read the key in it, and no other logger runs on it meanwhile.
pub(super) fn open_flash(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let file = options.open(path)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(io::Error::other("a logger runs on it")),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

/// A partition of a logger's flash.
#[derive(Clone)]
pub struct PcFlash {
    cells: Arc<Mutex<Cells>>,
    first: usize,
    bytes: usize,
}

impl PcFlash {
    /// The partitions of outbox and settings, in memory.
    pub fn in_memory() -> [Self; 2] {
        Self::partitions(Cells {
            bytes: vec![0xFF; FLASH_BYTES],
            file: None,
        })
    }

    /// The partitions of outbox and settings in the file at `path`, which is made if it is not there. A file that is longer, as QEMU's is,
    /// has them at its beginning.
    pub fn in_file(path: &Path) -> Result<[Self; 2]> {
        let open = || -> io::Result<Cells> {
            let mut file = open_flash(path)?;
            let mut bytes = vec![];
            (&mut file).take(FLASH_BYTES as u64).read_to_end(&mut bytes)?;
            if bytes.len() < FLASH_BYTES {
                bytes.resize(FLASH_BYTES, 0xFF);
                file.seek(SeekFrom::Start(0))?;
                file.write_all(&bytes)?;
            }
            Ok(Cells {
                bytes,
                file: Some(file),
            })
        };
        let cells = open().with_context(|| format!("cannot use {} as a logger's flash", path.display()))?;
        Ok(Self::partitions(cells))
    }

    fn partitions(cells: Cells) -> [Self; 2] {
        let cells = Arc::new(Mutex::new(cells));
        let outbox = OUTBOX_PAGES * PAGE_BYTES;
        [(0, outbox), (outbox, SETTINGS_PAGES * PAGE_BYTES)].map(|(first, bytes)| Self {
            cells: Arc::clone(&cells),
            first,
            bytes,
        })
    }

    fn cells(&self) -> MutexGuard<'_, Cells> {
        self.cells.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Where the bytes are among the cells.
    fn place(&self, offset: u32, length: usize) -> Result<std::ops::Range<usize>, NorFlashErrorKind> {
        let from = offset as usize;
        match from.checked_add(length) {
            Some(to) if to <= self.bytes => Ok(self.first + from..self.first + to),
            _ => Err(NorFlashErrorKind::OutOfBounds),
        }
    }

    fn change(
        &mut self,
        offset: u32,
        length: usize,
        change: impl Fn(usize, u8) -> u8,
    ) -> Result<(), NorFlashErrorKind> {
        let place = self.place(offset, length)?;
        let Cells { bytes, file } = &mut *self.cells();
        let cells = &mut bytes[place.clone()];
        for (at, cell) in cells.iter_mut().enumerate() {
            *cell = change(at, *cell);
        }
        let Some(file) = file else { return Ok(()) };
        let written = file
            .seek(SeekFrom::Start(place.start as u64))
            .and_then(|_| file.write_all(cells));
        written.map_err(|_| NorFlashErrorKind::Other)
    }
}

impl ErrorType for PcFlash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for PcFlash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        let place = self.place(offset, bytes.len())?;
        bytes.copy_from_slice(&self.cells().bytes[place]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes
    }
}

impl NorFlash for PcFlash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = PAGE_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        let length = to.checked_sub(from).ok_or(NorFlashErrorKind::OutOfBounds)?;
        self.change(from, length as usize, |_, _| 0xFF)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.change(offset, bytes.len(), |at, cell| cell & bytes[at])
    }
}

/// A logger with its flash and its clock.
pub struct PcLogger {
    logger: Box<RemoteLogger<PcFlash>>,
    flash: [PcFlash; 2],
    identity: Identity,
    start: Instant,
}

impl PcLogger {
    /// A logger that has just been switched on, on this flash.
    pub fn start(flash: [PcFlash; 2]) -> Result<Self> {
        let mut logger = Box::new(RemoteLogger::new());
        let [outbox, settings] = flash.clone();
        let identity = logger
            .open(outbox, settings)
            .map_err(|error| anyhow!("the logger cannot start: {error}"))?;
        Ok(Self {
            logger,
            flash,
            identity,
            start: Instant::now(),
        })
    }

    /// One whose flash is in memory, and empty.
    pub fn new() -> Self {
        Self::start(PcFlash::in_memory()).expect("a flash in memory does not fail")
    }

    /// Who it is.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The recording ends here, as if the base station had said so.
    pub fn finish(&mut self) {
        self.logger.finish();
    }

    /// Takes bytes from the line; `send` is given what it answers.
    pub fn receive(&mut self, bytes: &[u8], send: impl FnMut(&[u8])) {
        self.work(send, |logger, line| logger.receive(bytes, line));
    }

    /// Does one slice of the work that waits; true if there is more.
    pub fn poll(&mut self, send: impl FnMut(&[u8])) -> bool {
        self.work(send, |logger, line| logger.poll(line))
    }

    fn work<S: FnMut(&[u8]), T>(
        &mut self,
        send: S,
        work: impl FnOnce(&mut RemoteLogger<PcFlash>, &mut Line<S>) -> T,
    ) -> T {
        let mut line = Line {
            start: self.start,
            send,
            restart: false,
        };
        let done = work(&mut self.logger, &mut line);
        if line.restart || self.logger.has_failed() {
            match Self::start(self.flash.clone()) {
                Ok(started) => *self = started,
                Err(error) => eprintln!("{error:#}"),
            }
        }
        done
    }
}

impl Default for PcLogger {
    fn default() -> Self {
        Self::new()
    }
}

/// A board whose line goes wherever `send` puts the bytes; no stack to watch, no clock of the processor.
struct Line<S> {
    start: Instant,
    send: S,
    restart: bool,
}

impl<S: FnMut(&[u8])> Board for Line<S> {
    fn send(&mut self, bytes: &[u8]) {
        (self.send)(bytes);
    }

    fn ticks(&mut self) -> u64 {
        0
    }

    fn now_ms(&mut self) -> u64 {
        self.start.elapsed().as_millis() as u64
    }

    fn health(&mut self) -> Health {
        Health::default()
    }

    fn restart(&mut self) {
        self.restart = true;
    }
}
