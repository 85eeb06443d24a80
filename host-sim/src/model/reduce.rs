//! From finite elements to the reduced model: a basis of modes and of static vectors for each element.

use anyhow::{Result, anyhow, bail};
use nalgebra::{DMatrix, DVector, SMatrix, SVector, SymmetricEigen};
use spanwatch::bridge::{Path, ReducedBridge};
use spanwatch::capacity::{BASIS, ELEMENTS, FACTORS, PATH_NODES, SENSOR_PLACES};

use super::eigen::{self, natural_modes};
use super::frame::constraint::Row;
use super::modal::value;
use super::structure::{BridgeFrame, Structure};

/// A candidate for the basis joins it if this part of it, in the mass norm, is new.
const NEW_DIRECTION: f64 = 1e-6;
/// Eigenvalues of an element's share below this part of the whole are rounding.
const NO_STIFFNESS: f64 = 1e-12;

/// Reduces a bridge to the logger's basis.
///
/// # Errors
/// If it cannot stand, or needs more than a logger has room for (`src/capacity.rs`).
pub fn reduce<'a, B>(bridge: &'a B) -> Result<ReducedBridge<f64>>
where
    BridgeFrame: From<&'a B>,
{
    let structure = Structure::new(bridge.into())?;
    let BridgeFrame {
        name,
        frame,
        basis_modes,
        ..
    } = &structure.bridge;
    check_room(&structure)?;
    let stiffness = structure.stiffness(&[]);
    let modes = natural_modes(&stiffness, structure.mass())?;

    // Modes first, then what bends where one element goes soft, K0^-1 K_e phi_k, for mode after mode.
    let mut candidates: Vec<DVector<f64>> = (modes.shapes.column_iter().take(*basis_modes))
        .map(|shape| shape.into_owned())
        .collect();
    let loads: Vec<DVector<f64>> = (candidates.iter())
        .flat_map(|shape| {
            let shape = DMatrix::from_columns(std::slice::from_ref(shape));
            (structure.matrices.groups.iter()).map(move |share| share.times(&shape).column(0).into_owned())
        })
        .collect();
    let softened = eigen::solve(&stiffness, &DMatrix::from_columns(&loads))?;
    candidates.extend(softened.column_iter().map(|column| column.into_owned()));
    let span = mass_orthonormal(candidates, structure.mass());
    let n = span.ncols();
    if n < basis_modes + frame.groups.len() - 1 && n < structure.matrices.freedoms() {
        return Err(anyhow!(
            "bridge \"{name}\" leaves no room for damage in a basis of {BASIS} vectors: take fewer basis_modes"
        ));
    }

    // Rotated until the undamaged stiffness is diagonal.
    let rotated = natural_modes(&(span.transpose() * &stiffness * &span), &DMatrix::identity(n, n))?;
    let (values, basis) = (rotated.omega_squared, &span * rotated.shapes);

    let mut bridge = empty(&structure, n, &values)?;
    bridge.rayleigh = structure.bridge.damping.rayleigh(&modes.omega_squared);

    let scale = DMatrix::from_diagonal(&DVector::from_iterator(
        n,
        values.iter().map(|value| value.sqrt().recip()),
    ));
    for (element, share) in structure.matrices.groups.iter().enumerate() {
        let reduced = &scale * basis.transpose() * share.times(&basis) * &scale;
        let eigen = SymmetricEigen::new((&reduced + reduced.transpose()) * 0.5);
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > NO_STIFFNESS {
                let f = bridge.factor_count;
                if f == FACTORS {
                    return Err(anyhow!(
                        "bridge \"{name}\" bends in more ways than the {FACTORS} that a logger has memory for: take fewer basis_modes or fewer, simpler damage groups"
                    ));
                }
                bridge
                    .factors
                    .view_mut((0, f), (n, 1))
                    .copy_from(&(vector * value.sqrt()));
                bridge.factor_element[f] = element as u8;
                bridge.factor_count += 1;
            }
        }
    }

    let in_basis =
        |row: &Row| SVector::<f64, BASIS>::from_fn(|k, _| if k < n { value(row, basis.column(k)) } else { 0.0 });
    for (node, point) in structure.path.iter().enumerate() {
        bridge.path.position_m[node] = point.x_m;
        bridge.path.displacement.set_column(node, &in_basis(&point.vertical[0]));
        bridge.path.slope.set_column(node, &in_basis(&point.vertical[1]));
    }
    for (place, sensor) in structure.sensors.iter().enumerate() {
        bridge.sensor_node[place] = sensor.number;
        bridge.sensors.set_column(place, &in_basis(&sensor.row));
    }
    Ok(bridge)
}

/// Refuses what a logger has no memory for.
fn check_room(structure: &Structure) -> Result<()> {
    let name = &structure.bridge.name;
    for (count, room, what, mend) in [
        (
            structure.matrices.groups.len(),
            ELEMENTS,
            "damage groups",
            "put more elements into one group",
        ),
        (
            structure.path.len(),
            PATH_NODES,
            "nodes on its path",
            "divide the beams under it less",
        ),
        (structure.sensors.len(), SENSOR_PLACES, "sensors", "name fewer"),
        (structure.bridge.basis_modes, BASIS, "basis_modes", "take fewer"),
    ] {
        if count > room {
            bail!("bridge \"{name}\" has {count} {what}, but a logger has memory for {room}: {mend}");
        }
    }
    if structure.matrices.groups.is_empty() {
        bail!("bridge \"{name}\" has no damage group, so a logger would have nothing to find: name groups of beams");
    }
    if !structure.matrices.fixed.is_zero() {
        bail!(
            "bridge \"{name}\" has beams or springs outside its damage groups, and a logger's model is made of its groups alone: give each a group"
        );
    }
    Ok(())
}

fn empty(structure: &Structure, n: usize, values: &[f64]) -> Result<ReducedBridge<f64>> {
    let name = structure.bridge.name.as_str();
    Ok(ReducedBridge {
        name: name.try_into().map_err(|_| anyhow!("name is longer than 24 bytes"))?,
        basis: n,
        elements: structure.matrices.groups.len(),
        lambda: SVector::from_fn(|k, _| values.get(k).copied().unwrap_or(0.0)),
        factors: SMatrix::zeros(),
        factor_element: [0; FACTORS],
        factor_count: 0,
        path: Path {
            nodes: structure.path.len(),
            position_m: [0.0; PATH_NODES],
            displacement: SMatrix::zeros(),
            slope: SMatrix::zeros(),
        },
        sensor_node: [0; SENSOR_PLACES],
        sensors: SMatrix::zeros(),
        sensor_count: structure.sensors.len(),
        rayleigh: [0.0; 2],
    })
}

/// Gram-Schmidt in the mass inner product, twice over, dropping candidates that add no direction, until [`BASIS`] are full.
fn mass_orthonormal(candidates: Vec<DVector<f64>>, mass: &DMatrix<f64>) -> DMatrix<f64> {
    let mut kept: Vec<DVector<f64>> = Vec::new();
    for mut vector in candidates {
        if kept.len() == BASIS {
            break;
        }
        let norm = |v: &DVector<f64>| v.dot(&(mass * v)).sqrt();
        vector /= norm(&vector);
        for _ in 0..2 {
            for other in &kept {
                let along = other.dot(&(mass * &vector));
                vector.axpy(-along, other, 1.0);
            }
        }
        let rest = norm(&vector);
        if rest > NEW_DIRECTION {
            kept.push(vector / rest);
        }
    }
    DMatrix::from_columns(&kept)
}
