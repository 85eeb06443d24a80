//! What is in the firmware image: how much memory it takes, and whether it can panic.

use std::fs;
use std::path::Path;

use anyhow::{Context, ensure};
use object::elf::{SHF_ALLOC, SHF_EXECINSTR, SHF_WRITE, SHT_NOBITS};
use object::{File, Object, ObjectSection, ObjectSymbol, SectionFlags, SectionKind, SymbolKind};

/// Sizes of an image's parts in bytes, counted as the program `size` does.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sizes {
    /// Code and constants, interrupt vectors too.
    pub text: u64,
    /// Variables with an initial value: in flash, and copied to RAM at the start.
    pub data: u64,
    /// Variables that start at zero, or with what the RAM holds (`.uninit`).
    pub bss: u64,
    /// Room for the stack, from `memory.x`. `size` does not count it.
    pub stack: u64,
    /// The static that holds the logger, part of `bss`; 0 if the image has none.
    pub logger: u64,
}

impl Sizes {
    /// Sizes of the image at `path`.
    ///
    /// # Errors
    /// The file is missing or no ELF file.
    pub fn of(path: &Path) -> anyhow::Result<Self> {
        Self::in_elf(&read(path)?).with_context(|| format!("{} is no ELF image", path.display()))
    }

    /// Sizes of the image whose ELF file is `bytes`.
    ///
    /// # Errors
    /// It is no ELF file.
    pub fn in_elf(bytes: &[u8]) -> anyhow::Result<Self> {
        let elf = File::parse(bytes)?;
        let mut sizes = Self::default();
        for section in elf.sections() {
            let SectionFlags::Elf { sh_flags } = section.flags() else {
                continue;
            };
            let is = |flag: u32| sh_flags & u64::from(flag) != 0;
            if !is(SHF_ALLOC) {
                continue;
            }
            let no_bits = matches!(
                section.kind(),
                SectionKind::UninitializedData | SectionKind::Elf(SHT_NOBITS)
            );
            let part = if no_bits {
                &mut sizes.bss
            } else if is(SHF_EXECINSTR) || !is(SHF_WRITE) {
                &mut sizes.text
            } else {
                &mut sizes.data
            };
            *part += section.size();
        }
        let address = |name| elf.symbol_by_name(name).map(|symbol| symbol.address());
        if let (Some(top), Some(bottom)) = (address("_stack_start"), address("_stack_end")) {
            sizes.stack = top.saturating_sub(bottom);
        }
        let is_logger = |name: &str| name.contains("LOGGER");
        let logger = elf.symbols().find(|symbol| symbol.name().is_ok_and(is_logger));
        sizes.logger = logger.map_or(0, |symbol| symbol.size());
        Ok(sizes)
    }

    /// Flash that the image takes, bytes.
    pub fn flash(&self) -> u64 {
        self.text + self.data
    }

    /// RAM that its variables take, bytes; without the stack.
    pub fn ram(&self) -> u64 {
        self.data + self.bss
    }
}

/// Parts of the names of functions that end in a panic. The first is what every panic calls: where it is not linked, nothing can panic;
/// the others, from the core library, tell what kind of panic it is.
const PANICKING: [&str; 5] = [
    "rust_begin_unwind",
    "4core9panicking",
    "unwrap_failed",
    "expect_failed",
    "slice_index_fail",
];

/// Names of the functions in the image at `path` by which it can panic, as the linker has them; none if it cannot.
///
/// # Errors
/// The file is missing, no ELF file, or its names were taken out.
pub fn panicking(path: &Path) -> anyhow::Result<Vec<String>> {
    let bytes = read(path)?;
    let elf = File::parse(&*bytes).with_context(|| format!("{} is no ELF image", path.display()))?;
    let functions = elf.symbols().filter(|symbol| symbol.kind() == SymbolKind::Text);
    let names: Vec<&str> = functions.map(|symbol| symbol.name()).collect::<Result<_, _>>()?;
    ensure!(
        names.contains(&"main"),
        "{} does not name its functions, so nobody can tell whether it panics",
        path.display()
    );
    let panics = |name: &&str| PANICKING.iter().any(|part| name.contains(part));
    Ok(names.into_iter().filter(panics).map(str::to_owned).collect())
}

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    fs::read(path).with_context(|| {
        format!(
            "the image {} cannot be read; `sh tests/build-firmware.sh` builds it",
            path.display()
        )
    })
}
