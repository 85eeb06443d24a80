//! From the frame file to the frame: names become nodes, chains become beams, parts are built at their places.

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

use anyhow::{Result, anyhow, bail};
use nalgebra::Vector3;
use toml::Spanned;

use super::file::{BeamEntry, Direction, FrameFile, LinkEntry, Name, Part, PathEntry, SpringEntry};
use super::{Beam, DIRECTIONS, Follows, Frame, Link, LumpedMass, NODE_FREEDOMS, Node, Section, Spring};
use crate::model::path::PathLine;
use crate::model::structure::{BridgeFrame, Damping, SensorPlace};
use crate::toml_text;

/// Modes in a logger's basis if the file does not say.
const BASIS_MODES: usize = 8;
/// Elements into which a beam can be divided.
const MOST_ELEMENTS: usize = 100;
/// Nodes of a frame: its matrices, whole ones of six times as many rows, take 650 MB each then.
const MOST_NODES_IN_ALL: usize = 1500;
/// Nodes of a row.
const MOST_NODES: u32 = 1000;

/// Reads and checks the text of a frame file.
pub fn read(text: &str) -> Result<BridgeFrame> {
    let mut file: FrameFile = toml_text::parse(text)?;
    check_head(&file)?;
    let whole = Part {
        nodes: std::mem::take(&mut file.nodes),
        row: std::mem::take(&mut file.row),
        supports: std::mem::take(&mut file.supports),
        beam: std::mem::take(&mut file.beam),
        spring: std::mem::take(&mut file.spring),
        mass: std::mem::take(&mut file.mass),
        link: std::mem::take(&mut file.link),
    };
    let mut builder = Builder {
        text,
        sections: sections(text, &file)?,
        frame: Frame::default(),
        numbers: HashMap::new(),
        divided: BTreeMap::new(),
    };
    for place in &file.place {
        let Some(part) = file.part.get(place.part.get_ref()) else {
            return Err(builder.unknown("part", &place.part, file.part.keys()));
        };
        builder.build(part, &format!("{}.", place.name), Vector3::from(place.at_m))?;
    }
    builder.build(&whole, "", Vector3::zeros())?;

    let path = builder.path(&file.path)?;
    let mut sensors: Vec<SensorPlace> = Vec::new();
    for sensor in &file.sensor {
        if sensors.iter().any(|known| known.number == sensor.number) {
            bail!(
                "{}: sensor {} is there twice: give each its own number",
                builder.place(&sensor.node.span()),
                sensor.number
            );
        }
        let direction = match &sensor.direction {
            Direction::Vector(vector) => Vector3::from(*vector),
            Direction::Axis(axis) => Vector3::from_fn(|i, _| f64::from(u8::from(DIRECTIONS[i] == axis.as_str()))),
        };
        let Some(direction) = direction.try_normalize(1e-9) else {
            bail!(
                "{}: the direction of sensor {} must be \"x\", \"y\", \"z\" or a vector that is not zero",
                builder.place(&sensor.node.span()),
                sensor.number
            );
        };
        sensors.push(SensorPlace {
            number: sensor.number,
            name: (sensor.name.clone()).unwrap_or_else(|| format!("node {}", sensor.node.get_ref())),
            node: builder.node("", &sensor.node)?,
            direction,
        });
    }
    let mut masters = Vec::new();
    if let Some(condensation) = &file.condensation {
        let directions = builder.directions(&condensation.directions)?;
        for node in builder.nodes("", &condensation.nodes)? {
            masters.extend((0..NODE_FREEDOMS).filter(|&d| directions[d]).map(|d| (node, d)));
        }
    }
    Ok(BridgeFrame {
        name: file.name,
        frame: builder.frame,
        path,
        sensors,
        damping: Damping {
            ratio: file.damping_ratio,
            at_hz: file.damping_at_hz,
        },
        basis_modes: file.basis_modes.unwrap_or(BASIS_MODES),
        masters,
    })
}

fn check_head(file: &FrameFile) -> Result<()> {
    if file.name.is_empty() || file.name.len() > 24 {
        bail!("name must have 1 to 24 letters, not {}", file.name.len());
    }
    if !(0.0..0.5).contains(&file.damping_ratio) {
        bail!("damping_ratio must lie between 0 and 0.5, not {}", file.damping_ratio);
    }
    if let Some([low, high]) = file.damping_at_hz
        && !(low > 0.0 && high > low && high.is_finite())
    {
        bail!("damping_at_hz must be two rising frequencies, not {low} and {high}");
    }
    if file.basis_modes == Some(0) {
        bail!("basis_modes must be at least 1");
    }
    Ok(())
}

/// The sections with their materials, checked.
fn sections(text: &str, file: &FrameFile) -> Result<BTreeMap<String, Section>> {
    for (name, entry) in &file.materials {
        let material = entry.get_ref();
        let wrong = if !(material.E_npm2 > 0.0 && material.E_npm2.is_finite()) {
            format!("E_npm2 = {}, which must be positive", material.E_npm2)
        } else if !(material.nu > -1.0 && material.nu <= 0.5) {
            format!("nu = {}, which must lie between -1 and 0.5", material.nu)
        } else if !(material.density_kgpm3 >= 0.0 && material.density_kgpm3.is_finite()) {
            format!(
                "density_kgpm3 = {}, which must be zero or positive",
                material.density_kgpm3
            )
        } else {
            continue;
        };
        bail!(
            "{}: material \"{name}\" has {wrong}",
            toml_text::place(text, &entry.span())
        );
    }
    let mut sections = BTreeMap::new();
    for (name, entry) in &file.sections {
        let section = entry.get_ref();
        let Some(material) = file.materials.get(section.material.get_ref()) else {
            bail!(
                "{}: section \"{name}\" is of material \"{}\", which is not in [materials]",
                toml_text::place(text, &section.material.span()),
                section.material.get_ref()
            );
        };
        for (key, value) in [
            ("A_m2", section.A_m2),
            ("J_m4", section.J_m4),
            ("Iy_m4", section.Iy_m4),
            ("Iz_m4", section.Iz_m4),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                bail!(
                    "{}: section \"{name}\" has {key} = {value}, which must be positive",
                    toml_text::place(text, &entry.span())
                );
            }
        }
        if !(section.added_kgpm >= 0.0 && section.added_kgpm.is_finite()) {
            bail!(
                "{}: section \"{name}\" has added_kgpm = {}, which must be zero or positive",
                toml_text::place(text, &entry.span()),
                section.added_kgpm
            );
        }
        let material = material.get_ref();
        sections.insert(
            name.clone(),
            Section {
                axial_n: material.E_npm2 * section.A_m2,
                torsion_nm2: material.E_npm2 / (2.0 * (1.0 + material.nu)) * section.J_m4,
                bending_nm2: [material.E_npm2 * section.Iy_m4, material.E_npm2 * section.Iz_m4],
                mass_kgpm: material.density_kgpm3 * section.A_m2 + section.added_kgpm,
                polar_inertia_kgm: material.density_kgpm3 * (section.Iy_m4 + section.Iz_m4),
            },
        );
    }
    Ok(sections)
}

/// A piece of a longer beam: what belongs to an end of the whole is left out where the piece does not lie at it.
fn within(whole: &Beam, at_first: bool, at_last: bool) -> Beam {
    let here = [at_first, at_last];
    Beam {
        offset_m: std::array::from_fn(|end| {
            if here[end] {
                whole.offset_m[end]
            } else {
                Vector3::zeros()
            }
        }),
        rigid_m: std::array::from_fn(|end| if here[end] { whole.rigid_m[end] } else { 0.0 }),
        released: std::array::from_fn(|end| if here[end] { whole.released[end] } else { [false; 3] }),
        ..whole.clone()
    }
}

/// A frame that grows.
struct Builder<'a> {
    text: &'a str,
    sections: BTreeMap<String, Section>,
    frame: Frame,
    /// Nodes by name.
    numbers: HashMap<String, usize>,
    /// Inner nodes of divided beams, by their ends.
    divided: BTreeMap<[usize; 2], Vec<usize>>,
}

impl Builder<'_> {
    fn build(&mut self, part: &Part, prefix: &str, at_m: Vector3<f64>) -> Result<()> {
        for (name, place_m) in &part.nodes {
            self.add_node(
                format!("{prefix}{}", name.get_ref()),
                at_m + Vector3::from(*place_m),
                &name.span(),
            )?;
        }
        for row in &part.row {
            if row.last < row.first || row.last - row.first >= MOST_NODES {
                bail!(
                    "{}: row \"{}\" goes from {} to {}: it must rise, by less than {MOST_NODES}",
                    self.place(&row.name.span()),
                    row.name.get_ref(),
                    row.first,
                    row.last
                );
            }
            for number in row.first..=row.last {
                let place_m =
                    at_m + Vector3::from(row.at_m) + Vector3::from(row.step_m) * f64::from(number - row.first);
                self.add_node(
                    format!("{prefix}{}{number}", row.name.get_ref()),
                    place_m,
                    &row.name.span(),
                )?;
            }
        }
        for (name, directions) in &part.supports {
            let held = self.directions(directions)?;
            for node in self.nodes(prefix, std::slice::from_ref(name))? {
                self.frame.nodes[node].held = held;
            }
        }
        for beam in &part.beam {
            self.add_beams(beam, prefix)?;
        }
        for spring in &part.spring {
            self.add_springs(spring, prefix)?;
        }
        for mass in &part.mass {
            for node in self.nodes(prefix, &mass.nodes)? {
                self.frame.masses.push(LumpedMass {
                    node,
                    mass_kg: mass.kg,
                    inertia_kgm2: mass.inertia_kgm2,
                });
            }
        }
        for link in &part.link {
            self.add_links(link, prefix)?;
        }
        Ok(())
    }

    fn add_node(&mut self, name: String, place_m: Vector3<f64>, span: &Range<usize>) -> Result<usize> {
        let number = self.frame.nodes.len();
        if number >= MOST_NODES_IN_ALL {
            bail!(
                "{}: more than {MOST_NODES_IN_ALL} nodes; divide the beams into fewer elements",
                self.place(span)
            );
        }
        if self.numbers.insert(name.clone(), number).is_some() {
            bail!("{}: node \"{name}\" is there twice: rename one", self.place(span));
        }
        self.frame.nodes.push(Node {
            name,
            place_m,
            held: [false; NODE_FREEDOMS],
        });
        Ok(number)
    }

    fn add_beams(&mut self, entry: &BeamEntry, prefix: &str) -> Result<()> {
        let (named, span) = match (&entry.nodes, &entry.chains) {
            (Some(nodes), None) => (vec![nodes.get_ref()], nodes.span()),
            (None, Some(chains)) => (chains.get_ref().iter().collect(), chains.span()),
            _ => bail!(
                "{}: a [[beam]] needs either nodes or chains",
                self.place(&entry.section.span())
            ),
        };
        let line = self.place(&span);
        let mut chains = Vec::new();
        for names in named {
            let chain = self.nodes(prefix, names)?;
            if chain.len() < 2 {
                bail!("{line}: a beam needs at least two nodes");
            }
            chains.push(chain);
        }
        let whole = self.pattern(entry, &line)?;
        let divide = entry.divide.unwrap_or(1);
        if !(1..=MOST_ELEMENTS).contains(&divide) {
            bail!("{line}: divide must be 1 to {MOST_ELEMENTS}, not {divide}");
        }
        let mut groups = self.groups(entry, prefix, &chains, &line)?.into_iter();
        for chain in chains {
            let last = chain.len() - 2;
            for (at, ends) in chain.windows(2).enumerate() {
                let beam = Beam {
                    nodes: [ends[0], ends[1]],
                    group: groups.next().flatten(),
                    ..within(&whole, at == 0, at == last)
                };
                self.divide(beam, divide, &span)?;
            }
        }
        Ok(())
    }

    /// What all beams of an entry share, with what belongs to the ends of each chain.
    fn pattern(&self, entry: &BeamEntry, line: &str) -> Result<Beam> {
        let Some(&section) = self.sections.get(entry.section.get_ref()) else {
            return Err(self.unknown("section", &entry.section, self.sections.keys()));
        };
        let rigid_m = entry.rigid_m.unwrap_or_default();
        if !rigid_m.iter().all(|length| *length >= 0.0 && length.is_finite()) {
            bail!("{line}: rigid_m must be two lengths of zero or more, not {rigid_m:?}");
        }
        let mut released = [[false; 3]; 2];
        for (end, names) in entry.release.iter().flatten().enumerate() {
            let directions = self.directions(names)?;
            if directions[..3].contains(&true) {
                bail!("{line}: only the moments rx, ry and rz of a beam's end can be released");
            }
            released[end].copy_from_slice(&directions[3..]);
        }
        Ok(Beam {
            up: entry.up.map(Vector3::from),
            offset_m: entry.offset_m.unwrap_or_default().map(Vector3::from),
            rigid_m,
            released,
            ..Beam::plain([0, 0], section)
        })
    }

    /// The damage group of each beam of the chains.
    fn groups(
        &mut self,
        entry: &BeamEntry,
        prefix: &str,
        chains: &[Vec<usize>],
        line: &str,
    ) -> Result<Vec<Option<usize>>> {
        let beams: Vec<usize> = chains.iter().map(|chain| chain.len() - 1).collect();
        let Some(groups) = &entry.groups else {
            let group = entry.group.as_ref().map(|name| self.group(prefix, name));
            return Ok(vec![group; beams.iter().sum()]);
        };
        if entry.group.is_some() {
            bail!("{line}: give these beams either group or groups, not both");
        }
        // One for each beam of a single chain, or for each chain.
        let of_each = if entry.nodes.is_some() {
            vec![1; beams[0]]
        } else {
            beams
        };
        if groups.get_ref().len() != of_each.len() {
            bail!(
                "{}: groups has {} names for {} {}",
                self.place(&groups.span()),
                groups.get_ref().len(),
                of_each.len(),
                if entry.nodes.is_some() { "beams" } else { "chains" }
            );
        }
        let named = groups.get_ref().iter().zip(of_each);
        Ok(named
            .flat_map(|(name, count)| vec![Some(self.group(prefix, name)); count])
            .collect())
    }

    /// Adds a beam in pieces: of equal length between its rigid zones.
    fn divide(&mut self, beam: Beam, pieces: usize, span: &Range<usize>) -> Result<()> {
        let [first, last] = beam.nodes;
        let from = self.frame.nodes[first].place_m + beam.offset_m[0];
        let to = self.frame.nodes[last].place_m + beam.offset_m[1];
        let along = (to - from).try_normalize(0.0).unwrap_or_default();
        let (from, to) = (from + along * beam.rigid_m[0], to - along * beam.rigid_m[1]);
        let mut nodes = vec![first];
        for piece in 1..pieces {
            let name = format!(
                "{}-{}/{piece}",
                self.frame.nodes[first].name, self.frame.nodes[last].name
            );
            let place_m = from + (to - from) * (piece as f64 / pieces as f64);
            nodes.push(self.add_node(name, place_m, span)?);
        }
        nodes.push(last);
        for (piece, ends) in nodes.windows(2).enumerate() {
            self.frame.beams.push(Beam {
                nodes: [ends[0], ends[1]],
                ..within(&beam, piece == 0, piece + 1 == pieces)
            });
        }
        self.divided.insert([first, last], nodes[1..pieces].to_vec());
        Ok(())
    }

    fn add_springs(&mut self, entry: &SpringEntry, prefix: &str) -> Result<()> {
        let nodes = self.nodes(prefix, entry.nodes.get_ref())?;
        let to: Vec<Option<usize>> = match &entry.to {
            None => vec![None; nodes.len()],
            Some(to) => {
                let others = self.nodes(prefix, to.get_ref())?;
                if others.len() != nodes.len() {
                    bail!(
                        "{}: to names {} nodes for {} springs",
                        self.place(&to.span()),
                        others.len(),
                        nodes.len()
                    );
                }
                others.into_iter().map(Some).collect()
            }
        };
        let stiffness = [
            entry.x_npm,
            entry.y_npm,
            entry.z_npm,
            entry.rx_nmprad,
            entry.ry_nmprad,
            entry.rz_nmprad,
        ];
        if let Some(direction) = stiffness.iter().position(|k| !(*k >= 0.0 && k.is_finite())) {
            bail!(
                "{}: a spring's stiffness in {} is {}: it must be zero or positive",
                self.place(&entry.nodes.span()),
                DIRECTIONS[direction],
                stiffness[direction]
            );
        }
        let group = entry.group.as_ref().map(|name| self.group(prefix, name));
        for (node, to) in nodes.into_iter().zip(to) {
            self.frame.springs.push(Spring {
                node,
                to,
                stiffness,
                group,
            });
        }
        Ok(())
    }

    fn add_links(&mut self, entry: &LinkEntry, prefix: &str) -> Result<()> {
        let master = self.node(prefix, &entry.master)?;
        let follows = match &entry.equal {
            None => Follows::Rigidly,
            Some(directions) => Follows::Equally(self.directions(directions)?),
        };
        for slave in self.nodes(prefix, &entry.slaves)? {
            self.frame.links.push(Link { master, slave, follows });
        }
        Ok(())
    }

    /// The path; between two of its nodes that a divided beam joins, the inner nodes of the beam are on it, too.
    fn path(&self, entry: &PathEntry) -> Result<PathLine> {
        let lines: Vec<&Vec<Name>> = match (&entry.line, &entry.left, &entry.right) {
            (Some(line), None, None) => vec![line],
            (None, Some(left), Some(right)) => vec![left, right],
            _ => bail!("[path] needs either line, or left and right"),
        };
        let mut all = Vec::new();
        for names in lines {
            let mut line: Vec<usize> = Vec::new();
            for node in self.nodes("", names)? {
                if let Some(&last) = line.last() {
                    if let Some(inner) = self.divided.get(&[last, node]) {
                        line.extend(inner);
                    } else if let Some(inner) = self.divided.get(&[node, last]) {
                        line.extend(inner.iter().rev());
                    }
                }
                line.push(node);
            }
            if line.len() < 2 {
                bail!("[path] must have at least two nodes on each line");
            }
            all.push(line);
        }
        if all.len() == 2 && all[0].len() != all[1].len() {
            bail!(
                "[path] has {} nodes on the left and {} on the right: they must stand side by side",
                all[0].len(),
                all[1].len()
            );
        }
        Ok(PathLine {
            lines: all,
            rail_height_m: entry.rail_height_m,
        })
    }

    /// The number of a damage group, new or known.
    fn group(&mut self, prefix: &str, name: &str) -> usize {
        let name = format!("{prefix}{name}");
        let groups = &mut self.frame.groups;
        groups.iter().position(|known| *known == name).unwrap_or_else(|| {
            groups.push(name);
            groups.len() - 1
        })
    }

    /// The nodes of a list of names and ranges.
    fn nodes(&self, prefix: &str, names: &[Name]) -> Result<Vec<usize>> {
        let mut nodes = Vec::new();
        for name in names {
            let Some((from, to)) = name.get_ref().split_once("..") else {
                nodes.push(self.node(prefix, name)?);
                continue;
            };
            let stem = from.trim_end_matches(|c: char| c.is_ascii_digit());
            let numbers = (
                from[stem.len()..].parse::<u32>(),
                to.strip_prefix(stem).map(str::parse::<u32>),
            );
            let (Ok(first), Some(Ok(last))) = numbers else {
                bail!(
                    "{}: \"{}\" is no range of nodes: write one such as \"L0..L8\"",
                    self.place(&name.span()),
                    name.get_ref()
                );
            };
            let step = |i: u32| if last >= first { first + i } else { first - i };
            for number in (0..=first.abs_diff(last).min(MOST_NODES)).map(step) {
                nodes.push(self.node(prefix, &Spanned::new(name.span(), format!("{stem}{number}")))?);
            }
        }
        Ok(nodes)
    }

    fn node(&self, prefix: &str, name: &Name) -> Result<usize> {
        (self.numbers.get(&format!("{prefix}{}", name.get_ref())).copied()).ok_or_else(|| {
            anyhow!(
                "{}: there is no node \"{prefix}{}\"; check the name, or add it to [nodes]",
                self.place(&name.span()),
                name.get_ref()
            )
        })
    }

    /// Marks of the directions of a list of names.
    fn directions(&self, names: &[Name]) -> Result<[bool; NODE_FREEDOMS]> {
        let mut marked = [false; NODE_FREEDOMS];
        for name in names {
            if name.get_ref() == "all" {
                marked = [true; NODE_FREEDOMS];
            } else if let Some(direction) = DIRECTIONS.iter().position(|known| known == name.get_ref()) {
                marked[direction] = true;
            } else {
                bail!(
                    "{}: \"{}\" is no direction: write x, y, z, rx, ry, rz or all",
                    self.place(&name.span()),
                    name.get_ref()
                );
            }
        }
        Ok(marked)
    }

    fn unknown<'k>(&self, what: &str, name: &Name, known: impl Iterator<Item = &'k String>) -> anyhow::Error {
        anyhow!(
            "{}: there is no {what} \"{}\"; known are: {}",
            self.place(&name.span()),
            name.get_ref(),
            known.map(String::as_str).collect::<Vec<_>>().join(", ")
        )
    }

    fn place(&self, span: &Range<usize>) -> String {
        toml_text::place(self.text, span)
    }
}
