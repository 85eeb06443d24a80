use super::*;
use spanwatch::recorder::*;
fn recorded(scheme: Scheme, train: &PlanarTrain<f64>, speed_kmh: f64, step: f64, d: &Damage<f64>) -> (Vec<f64>, Vec<f64>) {
    let bridge = GIRDER50.reduced();
    let modal = ModalBridge::<f64, 8>::new(&bridge, d, &[2, 5, 8]);
    let dur = (train.length_m() + 50.0) / (speed_kmh / 3.6) + 3.0;
    let steps = (dur / 0.005).floor() as usize * (0.005 / step).round() as usize;
    let run = Run { entry_time_s: 1.0, ..Run::at(speed_kmh / 3.6) };
    let h = history_by(scheme, modal, train, run, step, steps);
    let every = (0.005 / step).round() as usize;
    let (mut out, mut raw) = (vec![], vec![]);
    for c in 0..3 {
        let f = AntiAlias::new(Some(40.0), step);
        let mut s = AntiAliasState::default();
        for (i, v) in column(&h.acceleration, c).into_iter().enumerate() {
            let y = f.apply(&mut s, v);
            if (i + 1) % every == 0 { out.push(y); raw.push(v); }
        }
    }
    (out, raw)
}
#[test]
fn study() {
    for (name, train, speed) in [("3d16", shinkansen(16), 270.0), ("3d16", shinkansen(16), 60.0), ("2d1", inspection(1), 60.0), ("2d16", inspection(16), 270.0)] {
        let d = damage(&[(5, 0.11)]);
        let (exact, xraw) = recorded(Scheme::Exact, &train, speed, 2e-5, &d);
        let (newmark, nraw) = recorded(Scheme::AverageAcceleration, &train, speed, 2e-5, &d);
        println!("{name} {speed}: converged pair differ {:.1e} raw {:.1e}", relative_rms(&newmark, &exact), relative_rms(&nraw, &xraw));
        for scheme in [Scheme::AverageAcceleration, Scheme::FoxGoodwin, Scheme::Exact] {
            for step in [5e-3, 2.5e-3, 5e-3 / 3.0, 1.25e-3, 1e-3, 5e-4, 2.5e-4] {
                let (y, raw) = recorded(scheme, &train, speed, step, &d);
                println!("  {scheme:?} {:.3} ms: {:.2e} raw {:.2e}", step * 1e3, relative_rms(&y, &exact), relative_rms(&raw, &xraw));
            }
        }
    }
}
