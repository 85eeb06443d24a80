//! The keys of loggers, in a file of the base station: whoever has it can be any of them.
//!
//! ```toml
//! [[logger]]
//! device = 12
//! name = "Viaduct 12"
//! last = 1                 # number of a key that was given
//! keys = [{ number = 1, key = "64 hexadecimal digits" }]
//!
//! [console]                # who may give orders through a running base station
//! key = "64 hexadecimal digits"
//! ```

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};
use spanwatch::session::seal::KEY_BYTES;
use spanwatch::session::{Device, Key};
use spanwatch::settings::Identity;

use crate::output;

/// The file where nobody names another.
pub const DEFAULT_FILE: &str = "spanwatch-keys.toml";

/// Bytes that are written as hexadecimal digits.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
struct Secret(#[serde(with = "hex::serde")] [u8; KEY_BYTES]);

#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct NumberedKey {
    number: u8,
    key: Secret,
}

#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LoggerKeys {
    device: Device,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    /// The last number that was given: none is given again.
    #[serde(default)]
    last: u8,
    keys: Vec<NumberedKey>,
}

#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Console {
    key: Secret,
}

#[derive(Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Contents {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    console: Option<Console>,
    #[serde(default, rename = "logger")]
    loggers: Vec<LoggerKeys>,
}

/// The keys of the loggers that a base station knows.
#[derive(Clone)]
pub struct KeyRing {
    names: BTreeMap<Device, Option<String>>,
    keys: BTreeMap<(Device, u8), [u8; KEY_BYTES]>,
    console: [u8; KEY_BYTES],
    demo: bool,
    /// It has the console's key in place of the loggers'.
    console_only: bool,
}

impl KeyRing {
    /// The ring where nobody has made keys: every logger has the key that everybody knows.
    pub fn demo() -> Self {
        Self {
            names: BTreeMap::new(),
            keys: BTreeMap::new(),
            console: *Key::DEMO.bytes(),
            demo: true,
            console_only: false,
        }
    }

    /// The ring of those who give orders through a running base station: it answers for every logger.
    pub fn for_console(&self) -> Self {
        Self {
            console_only: true,
            ..self.clone()
        }
    }

    /// Whether it is the ring without keys.
    pub fn is_demo(&self) -> bool {
        self.demo
    }

    /// The key of that number of a logger.
    pub fn find(&self, device: Device, number: u8) -> Option<Key> {
        if self.console_only {
            return (number == 0).then(|| self.console());
        }
        if self.demo {
            return (number == 0).then_some(Key::DEMO);
        }
        self.keys.get(&(device, number)).copied().map(Key::new)
    }

    /// Another key that is true from now on.
    pub fn trust(&mut self, identity: &Identity) {
        self.keys
            .insert((identity.device, identity.key_number), *identity.key.bytes());
    }

    /// The logger's name.
    pub fn name(&self, device: Device) -> Option<&str> {
        self.names.get(&device)?.as_deref()
    }

    /// The key of those who give orders through a running base station.
    pub fn console(&self) -> Key {
        Key::new(self.console)
    }

    /// Whether that is the key that everybody knows.
    pub fn console_is_open(&self) -> bool {
        self.console().is_demo()
    }

    /// The loggers, with the numbers of their keys.
    pub fn loggers(&self) -> impl Iterator<Item = (Device, Option<&str>, Vec<u8>)> {
        self.names.iter().map(|(&device, name)| {
            let numbers = self.keys.keys().filter(|(of, _)| *of == device);
            (device, name.as_deref(), numbers.map(|(_, number)| *number).collect())
        })
    }

    /// The newest key of a logger.
    pub fn newest(&self, device: Device) -> Option<Identity> {
        let (&(_, key_number), &key) = self.keys.range((device, 0)..=(device, u8::MAX)).next_back()?;
        Some(Identity {
            device,
            key_number,
            key: Key::new(key),
        })
    }
}

/// The file of keys.
#[derive(Debug, Clone)]
pub struct KeyFile {
    path: PathBuf,
}

impl KeyFile {
    /// The file at `path`, whether it is there or not.
    pub fn at(path: &Path) -> Self {
        Self { path: path.to_owned() }
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The keys in it, or the ring without keys if it is not there.
    ///
    /// # Errors
    /// It cannot be read, others than its owner could, or it holds something else.
    pub fn ring(&self) -> Result<KeyRing> {
        let Some(contents) = self.read()? else {
            return Ok(KeyRing::demo());
        };
        let keys = contents.loggers.iter().flat_map(|logger| {
            let of = logger.device;
            logger.keys.iter().map(move |key| ((of, key.number), key.key.0))
        });
        Ok(KeyRing {
            names: (contents.loggers.iter())
                .map(|logger| (logger.device, logger.name.clone()))
                .collect(),
            keys: keys.collect(),
            console: contents.console.map_or(*Key::DEMO.bytes(), |console| console.key.0),
            demo: false,
            console_only: false,
        })
    }

    /// Makes another key for a logger; it has the next number. `name` replaces the logger's.
    pub fn add(&self, device: Device, name: Option<String>) -> Result<Identity> {
        let _lock = self.lock()?;
        let mut contents = self.read()?.unwrap_or_default();
        let place = contents.loggers.iter().position(|logger| logger.device == device);
        let place = place.unwrap_or_else(|| {
            contents.loggers.push(LoggerKeys {
                device,
                name: None,
                last: 0,
                keys: vec![],
            });
            contents.loggers.len() - 1
        });
        let logger = &mut contents.loggers[place];
        logger.name = name.or(logger.name.take());
        let last = logger.keys.iter().map(|key| key.number).max();
        let Some(number) = logger.last.max(last.unwrap_or(0)).checked_add(1) else {
            bail!("logger {device} has used all 255 numbers of keys: give it another device number");
        };
        let key = Secret(random()?);
        let identity = Identity {
            device,
            key_number: number,
            key: Key::new(key.0),
        };
        logger.last = number;
        logger.keys.push(NumberedKey { number, key });
        self.write(&contents)?;
        Ok(identity)
    }

    /// Makes a key for those who give orders through a running base station.
    pub fn add_console(&self) -> Result<()> {
        let _lock = self.lock()?;
        let mut contents = self.read()?.unwrap_or_default();
        contents.console = Some(Console { key: Secret(random()?) });
        self.write(&contents)
    }

    /// Takes a key out: a logger that still has it is not heard any more. The newest only if it is `lost`.
    pub fn remove(&self, device: Device, number: u8, lost: bool) -> Result<()> {
        let _lock = self.lock()?;
        let mut contents = self.read()?.unwrap_or_default();
        let logger = contents.loggers.iter_mut().find(|logger| logger.device == device);
        let newest = (logger.iter().flat_map(|logger| &logger.keys))
            .map(|key| key.number)
            .max();
        if newest == Some(number) && !lost {
            bail!(
                "key {number} is the newest of logger {device}, and without it the logger is heard again only after a visit on the bench; \
                 --lost takes it out all the same"
            );
        }
        let found = logger.map(|logger| {
            let before = logger.keys.len();
            logger.keys.retain(|key| key.number != number);
            before > logger.keys.len()
        });
        if found != Some(true) {
            bail!("{} has no key {number} of logger {device}", self.path.display());
        }
        self.write(&contents)
    }

    /// Nobody else changes the file as long as this is held.
    fn lock(&self) -> Result<fs::File> {
        let path = self.path.with_extension("lock");
        let locked = fs::File::create(&path).and_then(|file| file.lock().map(|()| file));
        locked.with_context(|| format!("cannot lock the keys by {}", path.display()))
    }

    fn read(&self) -> Result<Option<Contents>> {
        let name = self.path.display();
        let text = match fs::read_to_string(&self.path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            text => text.with_context(|| format!("cannot read the keys in {name}"))?,
        };
        self.refuse_readable_by_others()?;
        // The error of the reader may quote a key.
        match toml::from_str(&text) {
            Ok(contents) => Ok(Some(contents)),
            Err(error) => bail!("{name} is no file of keys: {}", error.message()),
        }
    }

    #[cfg(unix)]
    fn refuse_readable_by_others(&self) -> Result<()> {
        use std::os::unix::fs::PermissionsExt as _;
        let name = self.path.display();
        if fs::metadata(&self.path)?.permissions().mode() & 0o077 != 0 {
            bail!("others than its owner can read the keys in {name}; `chmod 600 {name}` ends that");
        }
        Ok(())
    }

    #[cfg(not(unix))]
    fn refuse_readable_by_others(&self) -> Result<()> {
        Ok(())
    }

    fn write(&self, contents: &Contents) -> Result<()> {
        let head = "# Keys of loggers. Whoever can read this can be any of them, or their base station.\n";
        let text = format!(
            "{head}{}",
            toml::to_string(contents).context("the keys cannot be written as TOML")?
        );
        output::write_secret(&self.path, text.as_bytes())
    }
}

fn random() -> Result<[u8; KEY_BYTES]> {
    let mut bytes = [0; KEY_BYTES];
    getrandom::fill(&mut bytes).context("the system has no random numbers")?;
    Ok(bytes)
}
