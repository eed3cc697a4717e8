//! Places in the code of functions where a small change makes a fault, found in the syntax tree.

use proc_macro2::Span;
use std::ops::Range;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{BinOp, Expr, ExprBinary, ExprIf, ExprLit, ExprMethodCall, ExprRepeat, ExprUnary, Lit, Stmt, UnOp};

/// A change of an expression or a statement.
#[derive(Debug, Clone, PartialEq)]
pub struct Site {
    /// Path of the function, `module::Type::function`.
    pub function: String,
    pub bytes: Range<usize>,
    pub change: Change,
}

/// Right and wrong code for a place.
#[derive(Debug, Clone, PartialEq)]
pub enum Change {
    /// An expression with the text of its replacement.
    Expression(String),
    /// A statement that is left out.
    Removed,
}

/// The places in a file, without constants, patterns, types, macros and tests.
pub fn find(text: &str, module: &[String]) -> syn::Result<Vec<Site>> {
    let mut finder = Finder { text, path: module.to_vec(), functions: 0, sites: Vec::new() };
    finder.visit_file(&syn::parse_file(text)?);
    Ok(finder.sites)
}

struct Finder<'a> {
    text: &'a str,
    path: Vec<String>,
    /// Depth in functions.
    functions: usize,
    sites: Vec<Site>,
}

impl Finder<'_> {
    fn text(&self, part: &impl Spanned) -> &str {
        &self.text[part.span().byte_range()]
    }

    fn add(&mut self, place: Span, change: Change) {
        if self.functions > 0 {
            let function = self.path.join("::");
            self.sites.push(Site { function, bytes: place.byte_range(), change });
        }
    }

    fn replace(&mut self, place: &impl Spanned, by: String) {
        self.add(place.span(), Change::Expression(by));
    }

    fn function(&mut self, signature: &syn::Signature, body: &syn::Block) {
        if signature.constness.is_none() {
            self.path.push(signature.ident.to_string());
            self.functions += 1;
            self.visit_block(body);
            self.functions -= 1;
            self.path.pop();
        }
    }
}

impl<'ast> Visit<'ast> for Finder<'_> {
    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if !is_test(&item.attrs) {
            self.function(&item.sig, &item.block);
        }
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        if !is_test(&item.attrs) {
            self.function(&item.sig, &item.block);
        }
    }

    fn visit_trait_item_fn(&mut self, item: &'ast syn::TraitItemFn) {
        if let Some(body) = &item.default {
            self.function(&item.sig, body);
        }
    }

    fn visit_item_impl(&mut self, item: &'ast syn::ItemImpl) {
        if !is_test(&item.attrs) {
            self.path.push(self.text(&item.self_ty).split('<').next().unwrap_or_default().to_owned());
            visit::visit_item_impl(self, item);
            self.path.pop();
        }
    }

    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if item.ident != "tests" && !is_test(&item.attrs) {
            self.path.push(item.ident.to_string());
            visit::visit_item_mod(self, item);
            self.path.pop();
        }
    }

    // Constants, patterns, types and attributes are not evaluated when the program runs.
    fn visit_item_const(&mut self, _: &'ast syn::ItemConst) {}
    fn visit_impl_item_const(&mut self, _: &'ast syn::ImplItemConst) {}
    fn visit_item_static(&mut self, _: &'ast syn::ItemStatic) {}
    fn visit_pat(&mut self, _: &'ast syn::Pat) {}
    fn visit_type(&mut self, _: &'ast syn::Type) {}
    fn visit_path(&mut self, _: &'ast syn::Path) {}
    fn visit_angle_bracketed_generic_arguments(&mut self, _: &'ast syn::AngleBracketedGenericArguments) {}
    fn visit_attribute(&mut self, _: &'ast syn::Attribute) {}

    fn visit_expr_repeat(&mut self, repeat: &'ast ExprRepeat) {
        self.visit_expr(&repeat.expr);
    }

    fn visit_expr_binary(&mut self, binary: &'ast ExprBinary) {
        let has_let = |side: &Expr| matches!(side, Expr::Let(_)) || self.text(side).contains("let ");
        if let Some(other) = other(&binary.op)
            && !has_let(&binary.left)
            && !has_let(&binary.right)
        {
            let wrong = format!("{} {other} {}", self.text(&binary.left), self.text(&binary.right));
            self.replace(binary, wrong);
        }
        visit::visit_expr_binary(self, binary);
    }

    fn visit_expr_unary(&mut self, unary: &'ast ExprUnary) {
        if matches!(unary.op, UnOp::Neg(_) | UnOp::Not(_)) {
            self.replace(unary, self.text(&unary.expr).to_owned());
        }
        visit::visit_expr_unary(self, unary);
    }

    fn visit_expr_lit(&mut self, literal: &'ast ExprLit) {
        match &literal.lit {
            Lit::Float(float) => match float.base10_parse::<f64>() {
                Ok(0.0) => self.replace(literal, "1.0".into()),
                Ok(_) => self.replace(literal, format!("({} * 1.5)", self.text(literal))),
                Err(_) => {}
            },
            Lit::Int(_) => self.replace(literal, format!("({} + 1)", self.text(literal))),
            Lit::Bool(value) => self.replace(literal, (!value.value).to_string()),
            _ => {}
        }
    }

    fn visit_expr_if(&mut self, branch: &'ast ExprIf) {
        if !self.text(&branch.cond).contains("let ") && !matches!(&*branch.cond, Expr::Binary(_) | Expr::Unary(_)) {
            self.replace(&branch.cond, format!("!({})", self.text(&branch.cond)));
        }
        visit::visit_expr_if(self, branch);
    }

    fn visit_expr_method_call(&mut self, call: &'ast ExprMethodCall) {
        let receiver = self.text(&call.receiver);
        let arguments = || call.args.iter().map(|argument| self.text(argument)).collect::<Vec<_>>().join(", ");
        let wrong = match call.method.to_string().as_str() {
            "min" => format!("{receiver}.max({})", arguments()),
            "max" => format!("{receiver}.min({})", arguments()),
            "sin" => format!("{receiver}.cos()"),
            "cos" => format!("{receiver}.sin()"),
            "any" => format!("{receiver}.all({})", arguments()),
            "all" => format!("{receiver}.any({})", arguments()),
            "abs" | "sqrt" => receiver.to_owned(),
            _ => String::new(),
        };
        if !wrong.is_empty() {
            self.replace(call, wrong);
        }
        visit::visit_expr_method_call(self, call);
    }

    fn visit_stmt(&mut self, statement: &'ast Stmt) {
        if let Stmt::Expr(expression, Some(_)) = statement
            && matches!(expression, Expr::MethodCall(_) | Expr::Call(_) | Expr::Assign(_))
        {
            self.add(statement.span(), Change::Removed);
        }
        visit::visit_stmt(self, statement);
    }
}

fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| match &attribute.meta {
        syn::Meta::Path(path) => path.is_ident("test"),
        syn::Meta::List(list) => list.path.is_ident("cfg") && list.tokens.to_string().contains("test"),
        syn::Meta::NameValue(_) => false,
    })
}

/// The operator that is easily written by mistake.
fn other(operator: &BinOp) -> Option<&'static str> {
    Some(match operator {
        BinOp::Add(_) => "-",
        BinOp::Sub(_) => "+",
        BinOp::Mul(_) => "/",
        BinOp::Div(_) => "*",
        BinOp::Rem(_) => "/",
        BinOp::And(_) => "||",
        BinOp::Or(_) => "&&",
        BinOp::Eq(_) => "!=",
        BinOp::Ne(_) => "==",
        BinOp::Lt(_) => "<=",
        BinOp::Le(_) => "<",
        BinOp::Gt(_) => ">=",
        BinOp::Ge(_) => ">",
        BinOp::AddAssign(_) => "-=",
        BinOp::SubAssign(_) => "+=",
        BinOp::MulAssign(_) => "/=",
        BinOp::DivAssign(_) => "*=",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::{Change, find};

    #[test]
    fn faults_are_found_in_functions_only() {
        let text = "const A: f64 = 1.0 + 2.0;\n\
            impl Spring<'_> {\n fn f(&self, x: [f64; 3]) -> f64 {\n self.go();\n if let Some(1) = y && a < b { -x.abs() } else { 0.0 }\n }\n}\n\
            const fn g() -> u8 { 1 + 1 }\n#[cfg(test)]\nmod checks { fn h() { 1 + 1 } }\n";
        let sites = find(text, &["m".into()]).unwrap();
        assert!(sites.iter().all(|site| site.function == "m::Spring::f"), "{sites:?}");
        let mut found: Vec<(&str, &Change)> =
            sites.iter().map(|site| (&text[site.bytes.clone()], &site.change)).collect();
        found.sort_by_key(|(text, _)| *text);
        let changed = |text: &str| Change::Expression(text.into());
        assert_eq!(found[0], ("-x.abs()", &changed("x.abs()")));
        assert_eq!(found[1], ("0.0", &changed("1.0")));
        assert_eq!(found[2], ("a < b", &changed("a <= b")));
        assert_eq!(found[3], ("self.go();", &Change::Removed));
        assert_eq!(found[4], ("x.abs()", &changed("x")));
        assert_eq!(found.len(), 5);
    }
}
