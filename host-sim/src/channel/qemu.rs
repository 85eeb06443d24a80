//! A logger in QEMU: the firmware image on a modelled Cortex-M4F board, its serial line on a loopback socket.
//!
//! The other end of the socket is ours and open before QEMU starts, so no port can be taken from under us, and QEMU does
//! not run the image before the line is there. The image logs with defmt over semihosting, which QEMU writes to its
//! standard output.

use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, bail};
use defmt_decoder::{DecodeError, Table};

use super::Channel;
use super::pc::open_flash;

const PROGRAM: &str = "qemu-system-arm";
const MACHINE: &str = "mps2-an386";
/// The board's PSRAM: the flash is its beginning.
const PSRAM_BYTES: u64 = 16 << 20;
/// QEMU opens the line within a tenth of a second; on a machine under load it may take a few.
const START_TIMEOUT: Duration = Duration::from_secs(30);
/// The image takes bytes at every interrupt; only one that is dead keeps the line full for this long.
const SEND_TIMEOUT: Duration = Duration::from_secs(30);
/// QEMU closes the line a moment before it ends.
const END_TIMEOUT: Duration = Duration::from_secs(2);
const POLL: Duration = Duration::from_millis(5);
/// Log lines kept for [`Qemu::log`].
const KEPT_LINES: usize = 1000;

type Lines = Arc<Mutex<VecDeque<String>>>;

/// A running QEMU with a logger in it. Dropping it ends it.
pub struct Qemu {
    child: Child,
    line: TcpStream,
    log: Lines,
    complaints: Lines,
    readers: Vec<JoinHandle<()>>,
    /// Its flash: as long as it is open no other logger runs on it.
    _flash: File,
}

impl Qemu {
    /// Starts `image`.
    ///
    /// With `icount` an instruction of the logger takes 1 ns of its time, whatever the PC does: a tick of its clock
    /// (25 MHz) is 40 instructions, and a run can be repeated exactly. With `show_log` its log goes to stderr, each line
    /// behind `logger: `.
    ///
    /// # Errors
    /// The image is missing or no image of the logger, QEMU is not installed, or it does not start.
    pub fn start(image: &Path, icount: bool, show_log: bool) -> anyhow::Result<Self> {
        // Its file has a name only until QEMU has it open.
        let flash = OwnFlash::new();
        Self::start_on(image, &flash.0, icount, show_log)
    }

    /// As [`Self::start`], with the flash of the outbox in the file `flash`, which is made if it is not there. An image that is started again
    /// on the same file finds what was written before, however it ended.
    pub fn start_on(image: &Path, flash: &Path, icount: bool, show_log: bool) -> anyhow::Result<Self> {
        let elf = fs::read(image).with_context(|| {
            format!(
                "the logger's image {} cannot be read; `sh tests/build-firmware.sh` builds it",
                image.display()
            )
        })?;
        let table = Table::parse(&elf)
            .map_err(|error| anyhow!("{} is no image of the logger: {error:#}", image.display()))?
            .with_context(|| format!("{} is no image of the logger: it logs nothing", image.display()))?;
        let flash_file = open_flash(flash)
            .and_then(|file| file.set_len(PSRAM_BYTES).map(|()| file))
            .with_context(|| format!("cannot use {} as a logger's flash", flash.display()))?;
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).context("no loopback port is free for QEMU")?;
        listener.set_nonblocking(true)?;
        let port = listener.local_addr()?.port();

        let mut command = Command::new(PROGRAM);
        command
            .arg("-M")
            .arg(format!("{MACHINE},memory-backend=psram"))
            .arg("-object")
            .arg(format!(
                "memory-backend-file,id=psram,size={PSRAM_BYTES},share=on,mem-path={}",
                flash.display()
            ))
            .args(["-nographic", "-monitor", "none"])
            .arg("-chardev")
            .arg(format!("socket,id=line,host=127.0.0.1,port={port},nodelay=on"))
            .args(["-serial", "chardev:line"])
            .args(["-semihosting-config", "enable=on,target=native"])
            .arg("-kernel")
            .arg(image)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        if icount {
            command.args(["-icount", "shift=0"]);
        }
        end_with_us(&mut command);
        let mut child = command.spawn().map_err(|error| match error.kind() {
            ErrorKind::NotFound => {
                anyhow!("{PROGRAM} is not installed; on Debian and Ubuntu it is in the package qemu-system-arm")
            }
            _ => anyhow!("{PROGRAM} cannot be started: {error}"),
        })?;

        let (log, complaints) = (Lines::default(), Lines::default());
        let mut readers = Vec::new();
        if let Some(output) = child.stdout.take() {
            let log = Arc::clone(&log);
            readers.push(thread::spawn(move || read_log(output, &table, &log, show_log)));
        }
        if let Some(output) = child.stderr.take() {
            let complaints = Arc::clone(&complaints);
            readers.push(thread::spawn(move || read_complaints(output, &complaints)));
        }
        match accept(&listener, &mut child) {
            Ok(line) => Ok(Self {
                child,
                line,
                log,
                complaints,
                readers,
                _flash: flash_file,
            }),
            Err(error) => {
                end(&mut child, readers);
                Err(match said(&complaints) {
                    text if text.is_empty() => error,
                    text => error.context(text),
                })
            }
        }
    }

    /// The last lines that the logger has logged, oldest first: time, level, message.
    pub fn log(&self) -> Vec<String> {
        lines(&self.log)
    }

    /// Kills QEMU; the lines that the logger has logged up to then.
    pub fn kill(mut self) -> Vec<String> {
        end(&mut self.child, std::mem::take(&mut self.readers));
        self.log()
    }

    /// How QEMU ended, if it has: the image ends it when restarting does not help.
    pub fn ended(&mut self) -> io::Result<Option<ExitStatus>> {
        self.child.try_wait()
    }

    /// The line is closed: why?
    fn gone(&mut self) -> io::Error {
        let deadline = Instant::now() + END_TIMEOUT;
        let status = loop {
            match self.child.try_wait() {
                Ok(None) if Instant::now() < deadline => thread::sleep(POLL),
                Ok(status) => break status,
                Err(error) => return error,
            }
        };
        let how = status.map_or("it still runs".to_owned(), |status| status.to_string());
        let mut text = format!("QEMU has closed the line ({how})");
        for (who, said) in [
            ("it said", said(&self.complaints)),
            ("the logger's last words", last(&self.log)),
        ] {
            if !said.is_empty() {
                text += &format!("; {who}: {said}");
            }
        }
        io::Error::new(ErrorKind::ConnectionAborted, text)
    }
}

impl Channel for Qemu {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.line.write_all(bytes).map_err(|error| match error.kind() {
            ErrorKind::WouldBlock | ErrorKind::TimedOut => io::Error::new(
                ErrorKind::TimedOut,
                format!("the logger in QEMU took no bytes for {} s", SEND_TIMEOUT.as_secs()),
            ),
            ErrorKind::BrokenPipe | ErrorKind::ConnectionReset => self.gone(),
            _ => error,
        })
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        // A timeout of zero would mean none at all.
        self.line
            .set_read_timeout(Some(timeout.max(Duration::from_millis(1))))?;
        match self.line.read(buffer) {
            Ok(0) => Err(self.gone()),
            Ok(count) => Ok(count),
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => Ok(0),
                ErrorKind::ConnectionReset => Err(self.gone()),
                _ => Err(error),
            },
        }
    }
}

impl Drop for Qemu {
    fn drop(&mut self) {
        end(&mut self.child, std::mem::take(&mut self.readers));
    }
}

/// The name of a file for the board's PSRAM, and so for its flash, that goes with the logger.
struct OwnFlash(PathBuf);

impl OwnFlash {
    fn new() -> Self {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = format!("spanwatch-flash-{}-{number}", std::process::id());
        Self(std::env::temp_dir().join(name))
    }
}

impl Drop for OwnFlash {
    fn drop(&mut self) {
        // It is not there if QEMU did not start.
        let _ = fs::remove_file(&self.0);
    }
}

/// QEMU ends with this program, also if that is killed: two of them on one flash would spoil it.
#[cfg(target_os = "linux")]
fn end_with_us(command: &mut Command) {
    use std::os::unix::process::CommandExt as _;
    let ask = || {
        Ok(rustix::process::set_parent_process_death_signal(Some(
            rustix::process::Signal::KILL,
        ))?)
    };
    // SAFETY: between fork and exec only a system call is made, which takes no lock and no memory.
    unsafe { command.pre_exec(ask) };
}

#[cfg(not(target_os = "linux"))]
fn end_with_us(_command: &mut Command) {}

/// Waits for QEMU to open the line.
fn accept(listener: &TcpListener, child: &mut Child) -> anyhow::Result<TcpStream> {
    let deadline = Instant::now() + START_TIMEOUT;
    loop {
        match listener.accept() {
            Ok((line, _)) => {
                line.set_nonblocking(false)?;
                line.set_nodelay(true)?;
                line.set_write_timeout(Some(SEND_TIMEOUT))?;
                return Ok(line);
            }
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Err(error) => return Err(error).context("the line to QEMU cannot be opened"),
        }
        if let Some(status) = child.try_wait()? {
            bail!("QEMU ended before it opened the line ({status})");
        }
        if Instant::now() > deadline {
            bail!("QEMU did not open the line within {} s", START_TIMEOUT.as_secs());
        }
        thread::sleep(POLL);
    }
}

/// Ends QEMU and what reads from it.
fn end(child: &mut Child, readers: Vec<JoinHandle<()>>) {
    // Both fail only when it has ended already.
    let _ = child.kill();
    let _ = child.wait();
    for reader in readers {
        let _ = reader.join();
    }
}

/// Decodes the log until QEMU ends.
fn read_log(mut output: impl Read, table: &Table, log: &Lines, show: bool) {
    let mut decoder = table.new_stream_decoder();
    let mut chunk = [0; 1024];
    while let Ok(count @ 1..) = output.read(&mut chunk) {
        decoder.received(&chunk[..count]);
        loop {
            match decoder.decode() {
                Ok(frame) => {
                    let time = frame
                        .display_timestamp()
                        .map(|time| time.to_string())
                        .unwrap_or_default();
                    let level = frame.level().map_or("", |level| level.as_str()).to_uppercase();
                    let text = format!("{time:>12} {level:<5} {}", frame.display_message());
                    if show {
                        eprintln!("logger: {text}");
                    }
                    keep(log, text);
                }
                Err(DecodeError::UnexpectedEof) => break,
                // A reset cuts a line short; the next one is whole.
                Err(DecodeError::Malformed) => {
                    if !table.encoding().can_recover() {
                        return;
                    }
                }
            }
        }
    }
}

fn read_complaints(output: impl Read, complaints: &Lines) {
    for line in io::BufRead::lines(io::BufReader::new(output)).map_while(Result::ok) {
        keep(complaints, line);
    }
}

fn keep(lines: &Lines, line: String) {
    let mut lines = lines.lock().unwrap_or_else(PoisonError::into_inner);
    if lines.len() == KEPT_LINES {
        lines.pop_front();
    }
    lines.push_back(line);
}

fn lines(lines: &Lines) -> Vec<String> {
    let lines = lines.lock().unwrap_or_else(PoisonError::into_inner);
    lines.iter().cloned().collect()
}

fn said(complaints: &Lines) -> String {
    lines(complaints).join(" / ")
}

fn last(log: &Lines) -> String {
    lines(log).pop().unwrap_or_default().trim().to_owned()
}
