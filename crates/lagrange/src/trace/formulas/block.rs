//! All formulas of one mechanism, with what several of them share defined before.

use super::form::{Form, Symbol};
use super::layout::Sizes;
use crate::expression::{Function, Unary};
use crate::trace::derivative::mark_arguments;
use crate::trace::graph::{Graph, Id, Node};

/// The formulas of what is asked for, in that order.
#[derive(Debug, Clone)]
pub struct Block {
    /// What [`Symbol::Named`] stands for; each uses earlier ones alone.
    pub definitions: Vec<Form>,
    pub outputs: Vec<Form>,
}

/// How a graph is cut into lines.
#[derive(Debug, Clone, Copy)]
pub struct Cut {
    /// Widest formula, characters.
    pub width: usize,
    /// Whether functions are called on names alone, so that every line is one short statement.
    pub calls_on_names: bool,
}

impl Block {
    /// The `outputs` of a graph over q, v and the parameters; what is used twice gets a name.
    pub fn of_graph(graph: &Graph, outputs: &[Id], sizes: Sizes, cut: Cut) -> Block {
        let mut needed = vec![false; outputs.iter().max().map_or(0, |&id| id as usize + 1)];
        outputs.iter().for_each(|&id| needed[id as usize] = true);
        mark_arguments(graph, &mut needed);
        let mut uses = vec![0_usize; needed.len()];
        for id in (0..needed.len()).filter(|&id| needed[id]) {
            graph
                .arguments(id as Id)
                .for_each(|a| uses[a as usize] += 1);
        }
        outputs.iter().for_each(|&id| uses[id as usize] += 1);

        let mut block = Block {
            definitions: Vec::new(),
            outputs: Vec::new(),
        };
        let mut forms = vec![Form::Number(0.0); needed.len()];
        for id in (0..needed.len()).filter(|&id| needed[id]) {
            let node = graph.node(id as Id);
            let mut form = block.form(node, &forms, sizes, cut);
            if form.width() > cut.width {
                for argument in graph.arguments(id as Id).map(|a| a as usize) {
                    if !is_plain(&forms[argument]) {
                        forms[argument] = block.name(forms[argument].clone());
                    }
                }
                form = block.form(node, &forms, sizes, cut);
            }
            let alone = cut.calls_on_names && is_sign(&form);
            let shared = uses[id] > 1 && !is_plain(&form);
            forms[id] = if alone || shared {
                block.name(form)
            } else {
                form
            };
        }
        block.outputs = outputs
            .iter()
            .map(|&id| forms[id as usize].clone())
            .collect();
        block
    }

    /// Whether a formula calls `function`.
    pub fn calls(&self, function: Function) -> bool {
        let mut found = false;
        for form in self.definitions.iter().chain(&self.outputs) {
            form.visit(&mut |part| {
                found |= matches!(part, Form::Call(called, _) if *called == function);
            });
        }
        found
    }

    fn name(&mut self, form: Form) -> Form {
        self.definitions.push(form);
        Form::Symbol(Symbol::Named(self.definitions.len() - 1))
    }

    fn form(&mut self, node: Node, forms: &[Form], sizes: Sizes, cut: Cut) -> Form {
        let of = |id: Id| forms[id as usize].clone();
        let mut short = |id: Id| {
            let form = forms[id as usize].clone();
            match form {
                Form::Symbol(_) | Form::Number(_) => form,
                _ if cut.calls_on_names => self.name(form),
                _ => form,
            }
        };
        match node {
            Node::Constant(bits) => Form::Number(f64::from_bits(bits)),
            Node::Variable(index) => Form::Symbol(sizes.symbol(index)),
            Node::Add(a, b) => Form::sum([of(a), of(b)]),
            Node::Subtract(a, b) => Form::sum([of(a), negative(of(b))]),
            Node::Negate(a) => negative(of(a)),
            Node::Multiply(a, b) if a == b => Form::power(short(a), 2),
            Node::Multiply(a, b) => Form::product(1.0, [of(a), of(b)]),
            Node::Divide(a, b) => Form::quotient(of(a), of(b)),
            Node::Powi(a, power) => Form::power(short(a), power),
            Node::One(f, a) => Form::Call(Function::One(f), vec![short(a)]),
            Node::Two(f, a, b) => {
                let arguments = vec![short(a), short(b)];
                Form::Call(Function::Two(f), arguments)
            }
        }
    }

    /// Gives names to the functions and brackets that stand in these formulas `often` times or more and are not short.
    pub fn share(&mut self, often: usize, short: usize) {
        loop {
            let mut counts: Vec<(Form, usize)> = Vec::new();
            let all = self.definitions.iter().chain(&self.outputs);
            for form in all {
                form.visit(&mut |part| {
                    if matches!(part, Form::Call(..) | Form::Sum(_)) && part.width() > short {
                        match counts.iter_mut().find(|(known, _)| known == part) {
                            Some((_, count)) => *count += 1,
                            None => counts.push((part.clone(), 1)),
                        }
                    }
                });
            }
            // Parts come before what they are part of.
            let Some((part, _)) = counts.into_iter().find(|(_, count)| *count >= often) else {
                return;
            };
            let name = Form::Symbol(Symbol::Named(self.definitions.len()));
            for form in self.definitions.iter_mut().chain(&mut self.outputs) {
                *form = form.replace(&part, &name);
            }
            self.definitions.push(part);
        }
    }
}

fn negative(form: Form) -> Form {
    match form {
        Form::Sum(terms) => Form::Sum(
            terms
                .into_iter()
                .map(|t| Form::product(-1.0, [t]))
                .collect(),
        ),
        other => Form::product(-1.0, [other]),
    }
}

fn is_sign(form: &Form) -> bool {
    matches!(form, Form::Call(Function::One(Unary::Sign), _))
}

/// A number or a name, with or without a sign: not worth a name of its own.
fn is_plain(form: &Form) -> bool {
    match form {
        Form::Number(_) | Form::Symbol(_) => true,
        Form::Product(p) => {
            p.coefficient == -1.0
                && p.under.is_empty()
                && matches!(p.over.as_slice(), [Form::Symbol(_)])
        }
        _ => false,
    }
}
