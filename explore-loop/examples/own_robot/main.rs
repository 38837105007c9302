//! A robot of one's own: `EggCell` (in `egg.rs`) implements `Cell` for a rigid egg, and the loop explores it as it stands.
//!
//! ```sh
//! cargo run --release -p explore-loop --example own_robot -- 20
//! cargo run --release -p explore-loop --example own_robot -- 20 slips
//! ```
//! explores the egg in as many positions as the argument says (1 without one) and prints for each how it ended, what share of the egg the
//! camera was truly shown, and the semi-axes of the model; `closed` is claimed truly when all of it was shown and the axes are right.
//! With `slips` the jaws lose their hold when they press the egg on the table: the loop has to notice.
#![allow(clippy::print_stdout)]

mod egg;
mod judge;

use judge::explored;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let count = std::env::args().nth(1).map_or(Ok(1), |n| n.parse())?;
    println!(
        "seed  stop                    manipulations  shown    semi-axes, mm      frames failed"
    );
    let slips = std::env::args().nth(2).is_some_and(|word| word == "slips");
    let (mut claimed, mut wrong) = (0, 0);
    for seed in 0..count {
        let end = explored(seed, slips)?;
        let [a, b, c] = end.axes.map(|a| 1e3 * a);
        println!(
            "{seed:4}  {:22}  {:13}  {:5.1} %  {a:4.1} {b:4.1} {c:4.1}  {} of {}",
            end.stop,
            end.manipulations,
            100.0 * end.shown,
            end.failed,
            end.frames
        );
        claimed += usize::from(end.stop == "closed");
        wrong += usize::from(!end.is_honest());
    }
    println!("{claimed} of {count} closed, {wrong} of them falsely");
    if wrong > 0 {
        return Err("a surface was called closed that was not seen, or that is wrong".into());
    }
    Ok(())
}
