//! The firmware image in QEMU and the logger in this process say the same, byte for byte. Without QEMU or without the
//! image (`sh tests/build-firmware.sh`) this fails.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use host_sim::channel::{Channel, InProcess, Qemu, built_image};
use host_sim::replay::{self, Told};
use host_sim::station::Station;
use spanwatch::wire::message::{Event, Status};
use spanwatch::wire::{Decoder, Kind};

/// Keeps all bytes that come from the logger.
struct Tap<C> {
    channel: C,
    heard: Arc<Mutex<Vec<u8>>>,
}

impl<C: Channel> Channel for Tap<C> {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.channel.send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let count = self.channel.receive(buffer, timeout)?;
        self.heard
            .lock()
            .expect("one thread")
            .extend_from_slice(&buffer[..count]);
        Ok(count)
    }
}

/// The frames of the logger's events, as they were on the line, and its status at the end.
fn events(channel: impl Channel + 'static, recordings: &[&str]) -> (Vec<Vec<u8>>, usize, Status) {
    let heard = Arc::new(Mutex::new(Vec::new()));
    let mut station = Station::new(Box::new(Tap {
        channel,
        heard: Arc::clone(&heard),
    }));
    let mut alerts = 0;
    let mut status = Status::default();
    for recording in recordings {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings").join(recording);
        let prepared = replay::prepare(&path, None, replay::DEFAULT_SEED).expect("a recording");
        status = prepared
            .replay(&mut station, None, |told| {
                alerts += usize::from(matches!(told, Told::Alert { .. }));
                Ok(())
            })
            .expect("replays");
        assert_eq!(
            (status.rejected, status.health.overruns),
            (0, 0),
            "nothing is lost at full speed"
        );
    }
    assert_eq!(station.rejected(), 0);
    let bytes = heard.lock().expect("one thread").clone();
    let mut decoder = Decoder::new();
    let mut frames = Vec::new();
    let mut begin = 0;
    for (end, &byte) in bytes.iter().enumerate() {
        if decoder
            .push(byte)
            .is_some_and(|frame| frame.kind == Kind::Event && frame.message::<Event>().is_some())
        {
            frames.push(bytes[begin..=end].to_vec());
        }
        if byte == 0 {
            begin = end;
        }
    }
    (frames, alerts, status)
}

#[test]
fn the_image_in_qemu_sends_the_same_bytes_as_the_logger_in_this_process() {
    let image = std::env::var_os("SPANWATCH_IMAGE").map_or_else(|| built_image("logger"), PathBuf::from);
    let recordings = [
        "healthy-60kmh.csv",
        "case1-60kmh.csv",
        "case4-60kmh-noise5-3nodes.csv",
        "case8-3d-270kmh-noise2-3nodes.csv",
    ];
    let (here, alerts, _) = events(InProcess::new(), &recordings);
    assert_eq!(alerts, 3);
    // A passage each and the alerts.
    assert_eq!(here.len(), recordings.len() + alerts);

    let qemu = Qemu::start(&image, false, true).expect("QEMU and the image are there");
    let (there, _, status) = events(qemu, &recordings);
    for (here, there) in here.iter().zip(&there) {
        assert_eq!(here, there);
    }
    assert_eq!(here.len(), there.len());
    assert!(status.health.stack_peak_bytes > 0, "the stack is watched");
}
